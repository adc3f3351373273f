"""Convert predicted embedded beads to round filaments for `printctl.checks.lumens` to measure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim.gcode.bead import Bead
from sim.gcode.deposit.strands import Strands


def written_filaments(beads: Sequence[Bead], swell: Sequence[float] | None = None) -> Strands:
    """Convert the beads written by a file to filaments; without oozed threads and drops.

    Parameters
    ----------
    beads : sequence of Bead
        Of each head, embedded.
    swell : sequence of float, optional
        Of each one's diameters in the bath; 1 without.
    """
    factors = swell or [1.0] * len(beads)
    each = []
    for bead, factor in zip(beads, factors, strict=True):
        rows = np.flatnonzero(bead.writes & bead.lays)
        area = np.pi / 4 * (bead.width_mm[rows] * factor) ** 2
        each.append(
            Strands(
                bead.pieces.start[rows],
                bead.pieces.end[rows],
                area * bead.pieces.length[rows],
                area,
                bead.stroke[rows],
                bead.line[rows],
            )
        )
    return Strands.joined(each)
