"""Stretches that a picture can't judge, and gaps that something else would explain.

Begin with `unseen_ways.py`.
"""
