"""Simulated Klipper firmware.

Goes in: bytes of a host. Comes out: Klipper's replies. Begin with `firmware.py`.
"""
