"""Run a recipe over a well plate: a run per well, one combined job, results of scanned wells.

Goes in: a recipe with a plate. Comes out: one job, a run for each scanned well, a report. Begin
with `run.py`.
"""
