"""Toolpaths by FRESH layers or embedded writing: correct the design, plan moves, write G-code.

Goes in: a network or solid, and options. Comes out: a `Toolpath`, then G-code text. Begin with
`toolpath.py`.
"""

from design.toolpath.toolpath import MoveBuilder, MoveKind, Toolpath, join_toolpaths

__all__ = ["MoveBuilder", "MoveKind", "Toolpath", "join_toolpaths"]
