"""Toolpaths: the needle's planned moves, their planning, and their G-code."""

from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import MoveKind, Toolpath, join_toolpaths

__all__ = ["MoveBuilder", "MoveKind", "Toolpath", "join_toolpaths"]
