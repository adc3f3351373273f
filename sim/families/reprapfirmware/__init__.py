"""Simulated RepRapFirmware.

Goes in: bytes of a host. Comes out: RepRapFirmware's replies. Begin with `firmware.py`.
"""
