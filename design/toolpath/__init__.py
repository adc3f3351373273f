"""The needle's moves as values, and the rooms that plan and write them."""

from design.toolpath.moves import MoveBuilder
from design.toolpath.toolpath import MoveKind, Toolpath, joined

__all__ = ["MoveBuilder", "MoveKind", "Toolpath", "joined"]
