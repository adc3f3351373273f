"""Share of ink at each place along the lines, learned from the look itself.

Begin with `learn.py`.
"""
