"""Run over a well plate: each well's own run, the combined job, the scanned wells.

Goes in: a recipe with a plate. Comes out: one job, a run for each scanned well, a report. Begin
with `run.py`.
"""
