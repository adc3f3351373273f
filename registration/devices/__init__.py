"""Optics of each instrument: cameras, lenses, microscopes, OCT, laser lines."""
