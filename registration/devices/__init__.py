"""Optics of each instrument: cameras, lenses, microscopes, OCT, laser lines.

Goes in: pictures or scans of known targets. Comes out: calibrations. Begin with `lens/fit.py`.
"""
