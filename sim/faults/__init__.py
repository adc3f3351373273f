"""Faults planned for a simulated printer: cable, clock, gauge.

Goes in: a fault file. Comes out: a cable, a clock or a gauge that misbehaves as planned. Begin
with `fault_file.py`.
"""
