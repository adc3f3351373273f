"""The wall around a lumen: its profile, the level where it lies, gel-like material in it.

Goes in: traced sections. Comes out: walls in mm. Begin with `wall_profile.py`.
"""
