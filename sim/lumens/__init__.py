"""Kernels that measure a printed lumen: open width, rays to its wall, leaks between strands.

Goes in: printed lines as arrays. Comes out: widths and distances, mm. Begin with
`width_kernels.py`.
"""
