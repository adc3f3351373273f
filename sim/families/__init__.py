"""Simulators and readers of firmware families, one package each.

Goes in: a printer's profile. Comes out: its simulated printer, or its reader. Begin with
`registry.py`.
"""
