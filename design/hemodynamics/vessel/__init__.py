"""Lumped elements of one vessel: resistance, inertance, compliance, impedance.

Goes in: a vessel's centreline, radii and fluid. Comes out: its coefficients in a flow problem.
Begin with `resistance.py`.
"""
