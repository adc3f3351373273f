"""Planned faults of a simulated printer: cable, clock, ink; with fault file and simulated gauge.

Goes in: a fault file. Comes out: a cable, a clock or a gauge that misbehaves as planned. Begin
with `fault_file.py`.
"""
