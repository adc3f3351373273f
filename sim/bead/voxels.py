"""Render a predicted bead as voxels, by the kernels of `sim.deposit.lay`."""

from __future__ import annotations

import numpy as np

from sim.bead.predict import Bead
from sim.deposit.lay import Deposit, deposit_of_areas
from sim.deposit.strands import Strands


def bead_deposit(bead: Bead, voxel_mm: float, swell: float = 1.0) -> Deposit:
    """Lay a predicted bead into voxels, oozed threads included; drops aren't.

    Parameters
    ----------
    bead : Bead
    voxel_mm : float, mm
    swell : float
        Of diameters; an embedded filament's area grows by its square, a line's in a layer, whose
        height stays, by itself.

    Raises
    ------
    DepositError
        When nothing is laid or the grid would be too large.
    """
    chosen = np.flatnonzero(bead.lays)
    grown = swell**2 if bead.style == "embedded" else swell
    area = bead.area_mm2[chosen] * grown
    lines = Strands(
        bead.pieces.start[chosen],
        bead.pieces.end[chosen],
        area * bead.pieces.length[chosen],
        area,
        bead.stroke[chosen],
        bead.line[chosen],
    )
    return deposit_of_areas(lines, voxel_mm, bead.style, standing_ul=bead.dropped_ul)
