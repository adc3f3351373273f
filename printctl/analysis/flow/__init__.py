"""Solve a network's 0D, 1D and 3D flow as a recipe asks, as designed or printed; write the files.

Goes in: a recipe's flow section and a network. Comes out: solutions, tables and pictures. Begin
with `solve.py`.
"""

from printctl.analysis.flow.outlets import pulsatile_conditions, steady_conditions
from printctl.analysis.flow.solve import (
    ONE_D,
    ONE_D_WAVES,
    TABLE,
    WAVES,
    one_d_options,
    read_waves,
    solve_section,
)
from printctl.analysis.flow.tables import NPZ, CsvTables, NpzTables

__all__ = [
    "NPZ",
    "ONE_D",
    "ONE_D_WAVES",
    "TABLE",
    "WAVES",
    "CsvTables",
    "NpzTables",
    "one_d_options",
    "pulsatile_conditions",
    "read_waves",
    "solve_section",
    "steady_conditions",
]
