"""Commands that design a part and prepare its print.

Goes in: words typed. Comes out: files and messages. Begin with `run.py`.
"""
