"""Simulated RepRapFirmware: commands and replies, two checksum types.

Goes in: bytes of a host. Comes out: RepRapFirmware's replies. Begin with `printer.py`.
"""
