"""Command line: parse a subcommand's options, call the package for the work, print the result.

A file parses its command's options, calls the package that does the work, and prints the result.
Begin with `main.py`.
"""
