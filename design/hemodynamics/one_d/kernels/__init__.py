"""Compiled kernels of the 1D solver: cells, nodes, time stepping."""
