"""Estimate the light at each place of an OCT scan, and separate gel from liquid as bright as gel.

Begin with `light.py`.
"""
