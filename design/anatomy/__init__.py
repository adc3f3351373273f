"""Grow vessel trees of a heart, kidney, liver or brain cortex from anatomical templates.

Goes in: a tissue, growth options and the user's landmarks. Comes out: trees with their
inlets' names, curved and clear of each other. Begin with `organ.py`.
"""
