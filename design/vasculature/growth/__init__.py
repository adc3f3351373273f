"""Grow one or several vessel trees in a tissue by constrained constructive optimisation.

Goes in: a tissue, a root and options. Comes out: a grown tree. Begin with `tree.py`.
"""
