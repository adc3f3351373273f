"""Compiled kernels of the 1D flow solver: rates in cells, states at vessel ends, time steps.

Goes in: cells and nodes as arrays. Comes out: their state some time steps later, in place. Begin
with `march.py`.
"""
