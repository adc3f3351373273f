"""Roughly estimate the displacement of earlier ink by the passing needle shaft, to warn of it.

A needle that moves through a yield-stress bath carries the bath beside it along; the yielded zone
is about as wide as the needle (Grosskopf et al., ACS Appl. Mater. Interfaces 10 (2018) 23353;
Friedrich & Seppala, Soft Matter 17 (2021) 8027). The displacement at a distance s from its surface
is taken as R e^(−s/R), R the needle's outer radius: at most a radius at the surface, gone within a
few radii. Neither the height nor the decay length was measured; so this ranks places and says
nothing in micrometres. Ink that touches the filament being written (joints, neighbours in a layer)
isn't counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from kernels.arrays import FloatArray, IntArray
from sim.gcode.bead.predict import Bead

REACH: Final = 3.0
"""Radii beyond the needle's surface that are looked at: e^-3 is 5 %."""
AT_ONCE: Final = 20_000
"""Places of the needle in one query, for the memory's sake."""


@dataclass(frozen=True)
class Drag:
    """The nearest passes of the shaft beside written ink.

    Attributes
    ----------
    worst_mm : float, mm
        Largest estimated displacement; 0 where the shaft passes nothing.
    line, dragged_line : int
        Lines that move the needle there, and that wrote the ink.
    places : int
        Pieces of ink passed within `REACH` radii.
    """

    worst_mm: float
    line: int
    dragged_line: int
    places: int


def drag(bead: Bead, needle_outer_mm: float) -> Drag:
    """Estimate how far the shaft pushes what other strokes wrote earlier, embedded writing only.

    Parameters
    ----------
    bead : Bead
    needle_outer_mm : float, mm
        The shaft stands vertical above the tip.
    """
    ink = np.flatnonzero(bead.lays & bead.writes)
    if bead.style == "layered" or not len(ink):
        return Drag(0.0, 0, 0, 0)
    radius = needle_outer_mm / 2
    place = (bead.pieces.start[ink] + bead.pieces.end[ink]) / 2
    tree = cKDTree(place[:, :2])
    needle = np.flatnonzero(bead.pieces.length > 1e-9)
    worst, lines, passed = 0.0, (0, 0), np.zeros(len(ink), bool)
    for first in range(0, len(needle), AT_ONCE):
        rows = needle[first : first + AT_ONCE]
        mover, met, gap = _passes(bead, tree, place, ink, rows, radius)
        passed[met] = True
        if not len(gap):
            continue
        nearest = int(gap.argmin())
        push = radius * float(np.exp(-gap[nearest] / radius))
        if push > worst:
            worst = push
            lines = (int(bead.line[mover[nearest]]), int(bead.line[ink[met[nearest]]]))
    return Drag(worst, *lines, int(passed.sum()))


def _passes(
    bead: Bead,
    tree: cKDTree,
    place: FloatArray,
    ink: IntArray,
    rows: IntArray,
    radius: float,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of a moving piece and earlier ink beside the shaft: both rows, and the gap, mm."""
    tip = (bead.pieces.start[rows] + bead.pieces.end[rows]) / 2
    near = tree.query_ball_point(tip[:, :2], (1 + REACH) * radius)
    count = np.array([len(some) for some in near], dtype=np.int64)
    met = np.concatenate([np.asarray(some, np.int64) for some in near])
    of = np.repeat(np.arange(len(rows)), count)
    mover, other = rows[of], ink[met]
    away = tip[of] - place[met]
    # Earlier ink of another stroke, at the tip's height or above it, that this one never touches.
    counts = (other < mover) & (bead.stroke[other] != bead.stroke[mover]) & (away[:, 2] <= radius)
    reach = (bead.width_mm[mover] + bead.width_mm[other]) / 2
    touches = (np.linalg.norm(away, axis=1) <= reach) & bead.writes[mover]
    pair = bead.stroke[mover] * len(bead) + other
    counts &= ~np.isin(pair, pair[touches])
    across = np.linalg.norm(away[:, :2], axis=1)[counts]
    return mover[counts], met[counts], np.maximum(across - radius, 0.0)
