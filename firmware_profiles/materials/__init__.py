"""Inks and support baths: rheology, density, temperatures, shape of the bead.

Goes in: an ink's or bath's YAML. Comes out: checked profiles. Begin with `inks_and_baths.py`.
"""
