"""Oxygen as the user asks for it, and the files it leaves."""

from printctl.oxygen.outputs import CAPTION, FIELD, SLICE, TABLE, hypoxia, solve_and_write

__all__ = ["CAPTION", "FIELD", "SLICE", "TABLE", "hypoxia", "solve_and_write"]
