"""Dry run of a G-code file: planned duration, tip path, exceeded limits, temperatures.

Goes in: a G-code file and a printer. Comes out: a `DryRun`. Begin with `run.py`.
"""
