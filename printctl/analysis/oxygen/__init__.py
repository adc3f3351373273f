"""Solve oxygen in vessels and tissue as a recipe asks; write table, field and picture.

Goes in: a recipe's section, a network and its flow. Comes out: tables, a field, a picture. Begin
with `outputs.py`.
"""

from printctl.analysis.oxygen.outputs import CAPTION, FIELD, SLICE, TABLE, hypoxia, solve_and_write

__all__ = ["CAPTION", "FIELD", "SLICE", "TABLE", "hypoxia", "solve_and_write"]
