"""Run a recipe's stages from tissue to report, skipping those that are up to date.

Goes in: a recipe and a folder. Comes out: a run folder with report.html and report.json. Begin
with `running/run.py`.
"""
