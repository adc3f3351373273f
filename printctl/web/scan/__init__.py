"""Scan page of the web interface: upload a scan, view slices, measure deviation from a design.

Goes in: an uploaded scan. Comes out: slices, a registration, its result. Begin with `service.py`.
"""
