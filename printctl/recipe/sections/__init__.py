"""Sections of a recipe, one a file.

Goes in: YAML. Comes out: checked models. Begin with `making.py`.
"""
