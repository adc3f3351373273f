"""Scan page of the web interface: a volume, its alignment and its deviation from the design.

Goes in: an uploaded scan. Comes out: slices, a registration, its result. Begin with `service.py`.
"""
