"""Planned faults of a simulated printer: fault file, cable, slowed clock, ink faults; test gauge.

Goes in: a fault file. Comes out: a cable, a clock or a gauge that misbehaves as planned. Begin
with `fault_file.py`.
"""
