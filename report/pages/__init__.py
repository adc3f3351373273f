"""Whole pages: registration, comparison, dye, network, plate.

Goes in: report.json's numbers. Comes out: HTML. Begin with `registration.py`.
"""
