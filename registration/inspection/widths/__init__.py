"""Widths of lines and lumens, and ink beside them.

Begin with `widths.py`.
"""
