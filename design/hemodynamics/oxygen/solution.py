"""The solution of an oxygen problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.network import FloatArray


@dataclass(frozen=True)
class OxygenSolution:
    """Steady oxygen in vessels and tissue.

    Attributes
    ----------
    conditions : OxygenConditions
    grid : TissueGrid
    concentration : (nx, ny, nz) float64, mM
        In the cells; 0 outside the tissue. Within about a cell of a thin vessel it is the mean
        over the grid's smoothing, below what stands at the wall.
    tissue_share : (nx, ny, nz) float64
        Of each cell: 0 outside and in lumens, 1 in tissue.
    entry, exit : (v,) float64, mM
        Mixed in the stream at both ends of each vessel, in the flow's direction; NaN where
        nothing flows.
    wall_flux : (v,) float64, nmol/s
        From each vessel into the tissue.
    supplied, drained, from_bath, consumed : float, nmol/s
        Into the vessels and out of them, through the tissue's surface, and taken up.
    flow_ul_s : float, µL/s
        Into the vessels.
    newton, cycles : int
        Steps on the finest grid, and cycles of multigrid in them.
    """

    conditions: OxygenConditions
    grid: TissueGrid
    concentration: FloatArray
    tissue_share: FloatArray
    entry: FloatArray
    exit: FloatArray
    wall_flux: FloatArray
    supplied: float
    drained: float
    from_bath: float
    consumed: float
    flow_ul_s: float
    newton: int
    cycles: int

    @property
    def imbalance(self) -> float:
        """What goes in less what goes out and is taken up, over what is taken up or supplied."""
        net = self.supplied + self.from_bath - self.drained - self.consumed
        return abs(net) / max(self.consumed, 1e-12 * self.supplied, 1e-300)

    def share_below(self, millimolar: float) -> float:
        """Share of the tissue, by volume, that holds less."""
        low = self.concentration < millimolar
        return float(self.tissue_share[low].sum() / self.tissue_share.sum())

    def worst(self) -> tuple[int, int, int]:
        """Cell, at least half of it tissue, that holds least."""
        shown = np.where(self.tissue_share >= 0.5, self.concentration, np.inf)
        i, j, k = np.unravel_index(int(np.argmin(shown)), shown.shape)
        return int(i), int(j), int(k)
