"""Stages of the design: tissue, vasculature, solids.

Goes in: the recipe's sections. Comes out: a network and solids. Begin with `vasculature.py`.
"""
