"""Flow coefficients of single vessels: resistance, losses, inertance, compliance, Womersley.

Goes in: a vessel's centreline, radii and fluid. Comes out: its coefficients in a flow problem.
Begin with `resistance.py`.
"""
