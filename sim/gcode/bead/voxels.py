"""Render a predicted bead as voxels, by the kernels of `sim.gcode.deposit.lay`."""

from __future__ import annotations

import numpy as np

from sim.errors import DepositError
from sim.gcode.bead.predict import Bead
from sim.gcode.deposit.ink_faults import NO_FAULTS, InkFaults
from sim.gcode.deposit.ink_timeline import Timeline
from sim.gcode.deposit.laid import Laid, laid_as_is, with_faults
from sim.gcode.deposit.lay import Deposit, deposit_of_laid
from sim.gcode.deposit.strands import Strands


def bead_deposit(
    bead: Bead, voxel_mm: float, swell: float = 1.0, faults: InkFaults = NO_FAULTS
) -> Deposit:
    """Lay a predicted bead into voxels, oozed threads included; drops aren't.

    Parameters
    ----------
    bead : Bead
    voxel_mm : float, mm
    swell : float
        Of diameters; an embedded filament's area grows by its square, a line's in a layer, whose
        height stays, by itself.
    faults : InkFaults
        What became of the ink.

    Raises
    ------
    DepositError
        When nothing is laid or the grid would be too large.
    """
    return deposit_of_laid(laid_bead(bead, swell, faults), voxel_mm)


def laid_bead(bead: Bead, swell: float = 1.0, faults: InkFaults = NO_FAULTS) -> Laid:
    """Return the ink of a predicted bead that lies; parameters as of `bead_deposit`.

    Raises
    ------
    DepositError
        When nothing is laid.
    """
    chosen = np.flatnonzero(bead.lays)
    if not len(chosen):
        raise DepositError("no ink is laid along any way, so nothing was deposited")
    grown = swell**2 if bead.style == "embedded" else swell
    area = bead.area_mm2[chosen] * grown
    pieces = bead.pieces
    lines = Strands(
        pieces.start[chosen],
        pieces.end[chosen],
        area * pieces.length[chosen],
        area,
        bead.stroke[chosen],
        bead.line[chosen],
    )
    ink = laid_as_is(lines, bead.style, bead.dropped_ul)
    time = np.column_stack([pieces.time[:-1], pieces.time[1:]])
    line = Timeline.of(
        time, bead.line - 1, pieces.length, pieces.push_ul + pieces.jump_ul, bead.writes
    )
    return with_faults(ink, chosen, line, faults)
