"""Lay the ink of a simulated print into voxels, from executed motion: layered or embedded.

Goes in: executed motion. Comes out: voxels of ink. Begin with `lay.py`.
"""
