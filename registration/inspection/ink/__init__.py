"""Appearance of ink over one background, and its presence along each line.

Begin with `presence.py`.
"""
