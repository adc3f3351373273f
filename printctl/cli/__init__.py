"""Command line: one file per subcommand.

A file parses its command's options, calls the package that does the work, and prints the result.
Begin with `main.py`.
"""
