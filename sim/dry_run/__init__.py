"""Simulate a whole G-code file without a printer: duration, tip path, limits exceeded, heating.

Goes in: a G-code file and a printer. Comes out: a `DryRun`. Begin with `run.py`.
"""
