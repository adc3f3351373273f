"""Export print records: signed bundles, CSV tables, timelines; plan exact repeats.

Goes in: a print of the history. Comes out: a signed bundle, a CSV, a plan to repeat it. Begin with
`bundle.py`.
"""
