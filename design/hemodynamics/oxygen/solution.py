"""Data class of a steady oxygen solution: tissue field, vessel values, mass balance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from design.hemodynamics.oxygen.conditions import OxygenConditions
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from kernels.arrays import FloatArray

HALF: Final = 0.5
"""Share of tissue from which a cell counts as tissue and not as lumen, where it must be one."""


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

    def least(self) -> float:
        """Of the cells that are tissue by half or more, mM."""
        return max(float(self.concentration[self.tissue_share >= HALF].min()), 0.0)

    @cached_property
    def worst(self) -> tuple[int, int, int]:
        """Cell in the middle of the widest hypoxic place; without any, the one with least.

        Where much is without oxygen, which cell holds least is a matter of rounding.
        """
        tissue = self.tissue_share >= HALF
        hypoxic = tissue & (self.concentration < self.conditions.threshold_millimolar)
        if hypoxic.any():
            best = int(np.argmax(distance_transform_edt(hypoxic)))
        else:
            best = int(np.argmin(np.where(tissue, self.concentration, np.inf)))
        i, j, k = np.unravel_index(best, tissue.shape)
        return int(i), int(j), int(k)
