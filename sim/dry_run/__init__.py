"""Simulation of a whole G-code file without a printer: duration, path, limits, heat.

Goes in: a G-code file and a printer. Comes out: a `DryRun`. Begin with `run.py`.
"""
