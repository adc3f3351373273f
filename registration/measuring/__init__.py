"""Measure a registered part: sizes, openings, geometry, verdicts.

Goes in: a registered surface. Comes out: sections, defects, decisions. Begin with
`gauging/trace.py`.
"""
