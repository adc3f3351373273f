"""Stretches without ink: where they are, where they end, how sure they are.

Begin with `gaps.py`.
"""
