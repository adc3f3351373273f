"""Simulated camera over the dish: a picture of the ink that lies there.

Goes in: laid ink, a camera, a scene. Comes out: a picture of 8 bits. Begin with `paint.py`.
"""
