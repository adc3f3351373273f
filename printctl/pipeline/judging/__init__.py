"""Judge a print: registration in its own process, traces, verdict, pages.

Goes in: a scan and a run. Comes out: a verdict and pages. Begin with `verdict.py`.
"""
