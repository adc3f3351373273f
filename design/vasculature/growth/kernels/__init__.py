"""Compiled kernels of growth: cost, index, checks and the loop that adds terminals.

Goes in: arrays of a tree. Comes out: arrays of a larger one. Begin with `kernel.py`.
"""
