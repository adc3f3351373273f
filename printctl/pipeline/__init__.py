"""Pipeline: the stages of a run from tissue to report, each run only when out of date.

Goes in: a recipe and a folder. Comes out: a run folder with report.html and report.json. Begin
with `run.py`.
"""
