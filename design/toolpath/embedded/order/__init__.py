"""Order and direction in which the vessels of an embedded print are printed.

Begin with `schedule.py`.
"""
