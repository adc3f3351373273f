"""Kernels that measure a printed lumen: widest open circle, rays to its wall, leaks between lines.

Goes in: printed lines as arrays. Comes out: widths and distances, mm. Begin with
`width_kernels.py`.
"""
