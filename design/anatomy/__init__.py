"""Grow vessels by an organ's template: trunks on guiding layers, zones, curves.

Goes in: a tissue, growth options and what the user says of the organ. Comes out: trees with their
inlets' names, curved and clear of each other. Begin with `heart.py`.
"""
