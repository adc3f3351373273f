"""Openings of vessels at the faces of a part.

Goes in: traced sections and the scan. Comes out: openings. Begin with `mouths.py`.
"""
