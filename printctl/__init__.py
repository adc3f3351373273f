"""The printctl package: recipe, pipeline, preflight, printer link, command line and web page.

The command line starts in `cli/main.py`, the page in `web/serve.py`, a print in `machine/link/process.py`.
Begin with `cli/main.py`.
"""
