"""Trees grown by constrained constructive optimisation, one or several in a tissue.

Goes in: a tissue, a root and options. Comes out: a grown tree. Begin with `grow.py`.
"""
