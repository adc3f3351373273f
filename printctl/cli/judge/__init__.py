"""Commands that judge a print.

Goes in: words typed. Comes out: verdicts and messages. Begin with `register.py`.
"""
