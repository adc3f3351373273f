"""Convert predicted ink to the filaments that `printctl.lumens` measures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printctl.lumens.filaments import Filaments
from printctl.lumens.heads import stacked_filaments
from sim.bead import Bead


def written_filaments(beads: Sequence[Bead], swell: Sequence[float] | None = None) -> Filaments:
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
        each.append(
            Filaments(
                bead.pieces.start[rows],
                bead.pieces.end[rows],
                bead.width_mm[rows] / 2 * factor,
                bead.stroke[rows],
                bead.line[rows],
            )
        )
    return stacked_filaments(each)
