"""Grow vessel trees of a heart, kidney or brain cortex, by a template of the organ's vessels.

Goes in: a tissue, growth options and the user's landmarks. Comes out: trees with their
inlets' names, curved and clear of each other. Begin with `heart.py`.
"""
