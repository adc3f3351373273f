"""Compiled kernels of the 1D solver: cells, nodes, time stepping.

Goes in: cells and nodes as arrays. Comes out: their state some time steps later, in place. Begin
with `march.py`.
"""
