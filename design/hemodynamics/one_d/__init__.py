"""Solve 1D pulse-wave flow in compliant vessels; summarise it.

Goes in: a network and pulsatile conditions. Comes out: one periodic cycle of flow and pressure.
Begin with `solve.py`.
"""

from design.hemodynamics.one_d.grid import OneDOptions
from design.hemodynamics.one_d.solution import OneDSolution, one_d_summary, one_d_table, one_d_waves
from design.hemodynamics.one_d.solve import solve_one_d

__all__ = [
    "OneDOptions",
    "OneDSolution",
    "one_d_summary",
    "one_d_table",
    "one_d_waves",
    "solve_one_d",
]
