"""Vasculature of single organs: cortex, heart, kidney, liver.

Goes in: a tissue and its trunks. Comes out: a network. Begin with `heart.py`.
"""
