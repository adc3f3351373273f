"""Steps of the repair of triangle surfaces: limits, holes, duplicates, orientation.

Begin with `limits.py`.
"""
