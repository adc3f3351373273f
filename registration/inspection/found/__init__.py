"""Gaps, widths, stretches, blobs and lumens, read from ink along lines.

Begin with `gaps.py`.
"""
