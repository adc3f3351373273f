"""Commands that set up and drive a printer.

Goes in: words typed. Comes out: prints and messages. Begin with `print_job.py`.
"""
