"""A layer's picture made ready: cropped, evenly lit, aligned with an earlier one.

Begin with `working.py`.
"""
