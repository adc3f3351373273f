"""Well-plate runs of a recipe: set up wells, join their paths to one job, print, collect results.

Goes in: a recipe with a plate. Comes out: one job, a run for each scanned well, a report. Begin
with `run.py`.
"""
