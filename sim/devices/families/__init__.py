"""Simulated firmware (Klipper, Marlin, RepRapFirmware) and a reader of Aerotech programs.

Goes in: a printer's profile. Comes out: its simulated printer, or its reader. Begin with
`registry.py`.
"""
