"""Steps by which grown trees are fitted into a tissue beside each other.

Begin with `goal.py`.
"""
