"""The place of a layer in its picture: the shift of its lines.

Begin with `first_shift.py`.
"""
