"""Ink judged where it lies on, under or beside other ink.

Begin with `changed.py`.
"""
