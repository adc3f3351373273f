"""Past prints: records, and comparisons of runs.

Goes in: journals and runs. Comes out: bundles, tables. Begin with `bundle.py`.
"""
