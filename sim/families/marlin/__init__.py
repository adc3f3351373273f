"""Simulated Marlin firmware.

Goes in: bytes of a host. Comes out: Marlin's replies. Begin with `firmware.py`.
"""
