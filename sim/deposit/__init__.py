"""Ink that a simulated print lays: strands from executed motion, layer by layer, as voxels.

Goes in: executed motion. Comes out: voxels of ink. Begin with `lay.py`.
"""
