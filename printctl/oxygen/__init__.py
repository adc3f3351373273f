"""Oxygen calculations of recipes and commands, and their output files."""

from printctl.oxygen.outputs import CAPTION, FIELD, SLICE, TABLE, hypoxia, solve_and_write

__all__ = ["CAPTION", "FIELD", "SLICE", "TABLE", "hypoxia", "solve_and_write"]
