"""Estimation of the share of ink along lines from the look itself.

Begin with `learn.py`.
"""
