"""Solve steady oxygen transport: carried in vessels, diffusing and consumed in tissue.

Goes in: a tissue, a network and its steady flow. Comes out: concentration in tissue and vessels.
Begin with `solve.py`.
"""

from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.solution import (
    HALF,
    OxygenSolution,
    oxygen_summary,
    oxygen_table,
    write_oxygen_vti,
)
from design.hemodynamics.oxygen.solve import solve_oxygen, solve_refined
from design.hemodynamics.oxygen.tissue_grid import (
    TissueGrid,
    grid_of_box,
    grid_of_tissue,
    spacing_for,
)

__all__ = [
    "HALF",
    "OxygenConditions",
    "OxygenSolution",
    "TissueGrid",
    "grid_of_box",
    "grid_of_tissue",
    "oxygen_summary",
    "oxygen_table",
    "solve_oxygen",
    "solve_refined",
    "spacing_for",
    "write_oxygen_vti",
]
