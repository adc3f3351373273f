"""Simulated camera over the dish: optics, scene, laid ink and sensor, to a picture.

Goes in: laid ink, a camera, a scene. Comes out: a picture of 8 bits. Begin with `paint.py`.
"""
