"""Lines lit from the side, which show as ridges.

Begin with `ridge_light.py`.
"""
