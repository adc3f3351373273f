"""From a recipe to a checked print and its report: command line, web page, printer.

The command line starts in `cli/main.py`, the page in `web/serve.py`, a print in
`machine/process/process.py`. Begin with `cli/main.py`.
"""
