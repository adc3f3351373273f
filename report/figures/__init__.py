"""Figures of the report, as SVG.

Goes in: report.json's numbers. Comes out: SVG. Begin with `deviation.py`.
"""
