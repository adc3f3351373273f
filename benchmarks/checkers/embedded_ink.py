"""Deposited ink in the bath in writing order, from G-code alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.embedded_axes import Axes
from benchmarks.checkers.embedded_moves import Moves, passes_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
FINEST = 0.3
WINDOW_MM = 0.5
BESIDE_MM = 0.05
BIN_MM = 0.02
OFF_MM = 0.015


@dataclass(frozen=True)
class Ink:
    """Ink as short stretches, in the order of writing.

    Attributes
    ----------
    point : (n, 3) float64, mm
        Middle of each stretch.
    tip : (n, 3) float64, mm
        Its end: where the tip stands when it is written.
    radius, length : (n,) float64, mm
    move, stroke : (n,) int64
        Move of the file, and pass.
    arc : (n,) float64, mm
        Along the pass, at the stretch's end.
    vessel : (n,) int64
        Of the nearest axis; -1 for ink beside the network (a prime line, say).
    vessel_arc, off_mm, design_radius : (n,) float64, mm
        Along the vessel, distance from its axis and its radius there.
    """

    point: FloatArray
    tip: FloatArray
    radius: FloatArray
    length: FloatArray
    move: IntArray
    stroke: IntArray
    arc: FloatArray
    vessel: IntArray
    vessel_arc: FloatArray
    off_mm: FloatArray
    design_radius: FloatArray

    @property
    def volume_ul(self) -> FloatArray:
        """Of each stretch, µL."""
        volume: FloatArray = np.pi * self.radius**2 * self.length
        return volume


def written_ink(moves: Moves, axes: Axes, ul_per_e: float, longest_mm: float = np.inf) -> Ink:
    """Lay the ink: a stretch is at most `FINEST` radii long, and ``longest_mm``.

    Radius from the volume pushed over `WINDOW_MM` about each place, within its pass: E is written
    with few digits, so that a short move says little.
    """
    stroke = passes_of(moves)
    wrote = np.flatnonzero(stroke >= 0)
    length, pushed, number = moves.length[wrote], moves.pushed[wrote], stroke[wrote]
    along, total = np.cumsum(length), np.append(0.0, np.cumsum(pushed))
    first = np.flatnonzero(np.diff(number, prepend=-1))
    bounds = np.append(0.0, along)[np.append(first, len(number))]
    begin, end = bounds[number], bounds[number + 1]
    middle = along - length / 2
    rough = _radius(middle, begin, end, along, total, ul_per_e)
    count = np.ceil(length / np.minimum(FINEST * rough, longest_mm)).astype(np.int64).clip(min=1)
    of = np.repeat(np.arange(len(wrote)), count)
    nth = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    start, way = moves.start[wrote][of], (moves.end - moves.start)[wrote][of]
    at = (along - length)[of] + (nth + 0.5) / count[of] * length[of]
    point = start + ((nth + 0.5) / count[of])[:, None] * way
    gap, vessel, vessel_arc, design = axes.nearest(point)
    return Ink(
        point=point,
        tip=start + ((nth + 1.0) / count[of])[:, None] * way,
        radius=_radius(at, begin[of], end[of], along, total, ul_per_e),
        length=length[of] / count[of],
        move=wrote[of],
        stroke=number[of],
        arc=(along - length)[of] + (nth + 1.0) / count[of] * length[of] - begin[of],
        vessel=np.where(gap > design + BESIDE_MM, -1, vessel),
        vessel_arc=vessel_arc,
        off_mm=gap,
        design_radius=design,
    )


def _radius(
    at: FloatArray,
    begin: FloatArray,
    end: FloatArray,
    along: FloatArray,
    total: FloatArray,
    ul_per_e: float,
) -> FloatArray:
    places = np.append(0.0, along)
    low = np.clip(at - WINDOW_MM / 2, begin, np.maximum(end - WINDOW_MM, begin))
    high = np.clip(low + WINDOW_MM, begin, end)
    pushed = np.interp(high, places, total) - np.interp(low, places, total)
    radius: FloatArray = np.sqrt(np.maximum(pushed, 0.0) * ul_per_e / (np.pi * (high - low)))
    return np.maximum(radius, 1e-3)


def overlap_ul(ink: Ink, axes: Axes) -> float:
    """Ink laid where a vessel was written before, or past a joint and off every axis, µL.

    For ink in stretches no longer than `BIN_MM`.

    Of vessels written by one bead as wide as they are; those of several thinner ones aren't meant.
    """
    bins = np.concatenate([[0], np.cumsum(np.ceil(axes.length / BIN_MM).astype(np.int64) + 1)])
    where = bins[np.maximum(ink.vessel, 0)] + (ink.vessel_arc / BIN_MM).astype(np.int64)
    written_by = np.full(bins[-1], -1)
    again = np.zeros(len(where), dtype=bool)
    own, on_axis = ink.vessel >= 0, ink.off_mm <= OFF_MM
    for k in np.flatnonzero(own & on_axis):
        spot = where[k]
        if written_by[spot] < 0:
            written_by[spot] = ink.stroke[k]
        again[k] = written_by[spot] != ink.stroke[k]
    return float(ink.volume_ul[again | (own & ~on_axis & _past_joints(ink, axes))].sum())


def _past_joints(ink: Ink, axes: Axes) -> NDArray[np.bool_]:
    """Ink between a pass' end and where the pass is nearest to the node by which it ends."""
    tree = KDTree(axes.node)
    past = np.zeros(len(ink.point), dtype=bool)
    first = np.flatnonzero(np.diff(ink.stroke, prepend=-1))
    last = np.append(first[1:], len(ink.stroke)) - 1
    for low, high in zip(first.tolist(), last.tolist(), strict=True):
        for run in (np.arange(low, high + 1), np.arange(high, low - 1, -1)):
            tail = run[np.cumsum(ink.length[run]) <= 3 * ink.design_radius[run[0]]]
            _, node = tree.query(ink.point[run[0]])
            away = np.linalg.norm(ink.point[tail] - axes.node[node], axis=1)
            near = int(np.argmin(away)) if len(tail) else 0
            # A bead as wide as its vessel: side by side, several thinner ones pass the axis by.
            if near and ink.radius[tail[-1]] > 0.8 * ink.design_radius[tail[-1]]:
                past[tail[:near]] = True
    return past
