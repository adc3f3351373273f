"""Reduce 3D flow to vessels: flows at sections, effective radii, radii for wanted flows.

Goes in: a network and the 3D solution of its lumens. Comes out: flow, resistance or a new
radius of each vessel. Begin with `sections.py`.
"""
