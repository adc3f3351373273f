"""Centrelines of lumens in a mesh.

Goes in: a mesh. Comes out: lines with radii. Begin with `lumen_axes.py`.
"""
