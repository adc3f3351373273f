"""Gaps, widths, stretches, blobs and lumens, found from ink along lines.

Begin with `gaps.py`.
"""
