"""Kernels that measure a printed lumen: open width, rays to its wall, leaks between strands."""
