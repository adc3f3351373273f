"""Simulated Klipper firmware: commands, unverified line numbers, coordinate offsets.

Goes in: bytes of a host. Comes out: Klipper's replies. Begin with `printer.py`.
"""
