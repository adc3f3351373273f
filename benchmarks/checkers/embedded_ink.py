"""Vessel axes, moves of an embedded print, and the ink that they lay, from G-code alone.

Shares no code with the product. Lengths are mm, speeds mm/s, volumes µL, times s.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.networks import read_network
from benchmarks.checkers.read_gcode import Moves

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def passes_of(moves: Moves) -> IntArray:
    """Which pass each move writes, (n,), from 0; -1 for all others.

    A pass ends where the tip goes on without ink; the plunger alone may move within one.
    """
    writes, goes = moves.writes, ~moves.stands
    where = np.flatnonzero(goes)
    begins = writes[where] & ~np.concatenate([[False], writes[where][:-1]])
    number = np.full(len(writes), -1, dtype=np.int64)
    number[where] = np.where(writes[where], np.cumsum(begins) - 1, -1)
    return number


STEP_MM = 0.04
TRIED = 6


@dataclass(frozen=True)
class Axes:
    """Vessels as polylines, and dense points along them; mm.

    ``ends`` (v, 2): nodes at the first and last point of each vessel; ``node`` (m, 3); ``lines``:
    points and radius (k, 4); ``volume_ul`` as frustums, joints counted for each vessel that meets
    there. Of each dense point in ``tree``: ``vessel``, ``arc`` and ``radius`` (p,).
    """

    ends: IntArray
    node: FloatArray
    lines: list[FloatArray]
    length: FloatArray
    volume_ul: float
    tree: KDTree
    vessel: IntArray
    arc: FloatArray
    radius: FloatArray

    def at(self, vessel: int, arc: float) -> FloatArray:
        """Point and radius at an arc length of a vessel, (4,), mm."""
        line = self.lines[vessel]
        along = arcs(line[:, :3])
        return np.array([np.interp(arc, along, line[:, k]) for k in range(4)])

    def nearest(self, points: FloatArray) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
        """Distance, vessel, arc length and radius of the axis place nearest to each point.

        Where axes cross, the nearest of their dense points may be another axis's: of the `TRIED`
        nearest points the stretches on both sides are looked at.
        """
        _, tried = self.tree.query(points, k=TRIED)
        gap, arc = np.full(len(points), np.inf), np.zeros(len(points))
        own = tried[:, 0].copy()
        for index in tried.T:
            for step in (-1, 1):
                away, along = self._beside(points, index, step)
                nearer = away < gap - 1e-12
                gap, arc = np.where(nearer, away, gap), np.where(nearer, along, arc)
                own = np.where(nearer, index, own)
        return gap, self.vessel[own], arc, self.radius[own]

    def _beside(
        self, points: FloatArray, index: IntArray, step: int
    ) -> tuple[FloatArray, FloatArray]:
        """Distance to, and arc length on, the stretch from a dense point to the one beside it."""
        other = (index + step).clip(0, len(self.vessel) - 1)
        other = np.where(self.vessel[other] == self.vessel[index], other, index)
        start, way = self.tree.data[index], self.tree.data[other] - self.tree.data[index]
        size = np.maximum((way**2).sum(axis=1), 1e-12)
        part = (((points - start) * way).sum(axis=1) / size).clip(0.0, 1.0)
        away = np.linalg.norm(start + part[:, None] * way - points, axis=1)
        return away, self.arc[index] + part * (self.arc[other] - self.arc[index])


def arcs(points: FloatArray) -> FloatArray:
    """Arc length at each point of a polyline, mm."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def read_axes(path: Path) -> Axes:
    """Read a `network.csv`, mm; refuse one whose pieces of a vessel aren't in their order."""
    pieces = read_network(path)
    lines, ends = [], []
    first = np.flatnonzero(np.diff(pieces.vessel, prepend=pieces.vessel[0] - 1))
    if len(np.unique(pieces.vessel)) < len(first):
        raise ValueError(f"{path}: the pieces of a vessel don't stand together")
    last = np.append(first[1:], pieces.count)
    node = np.zeros((pieces.node_count, 3))
    for low, high in zip(first, last, strict=True):
        if np.any(pieces.node[low : high - 1, 1] != pieces.node[low + 1 : high, 0]):
            raise ValueError(f"{path}: vessel {pieces.vessel[low]} isn't in the order of its flow")
        points = np.vstack([pieces.start[low:high], pieces.end[high - 1]])
        radius = np.append(pieces.radius[low:high, 0], pieces.radius[high - 1, 1])
        lines.append(np.column_stack([points, radius]))
        ends.append((pieces.node[low, 0], pieces.node[high - 1, 1]))
        node[pieces.node[low, 0]], node[pieces.node[high - 1, 1]] = points[0], points[-1]
    r0, r1 = pieces.radius.T
    volume = np.pi / 3 * (pieces.length * (r0 * r0 + r0 * r1 + r1 * r1)).sum()
    return _dense(np.array(ends), node, lines, float(volume))


def _dense(ends: IntArray, node: FloatArray, lines: list[FloatArray], volume: float) -> Axes:
    dense: list[list[Any]] = [[], [], [], []]
    length = np.zeros(len(lines))
    for k, line in enumerate(lines):
        along = arcs(line[:, :3])
        length[k] = along[-1]
        at = np.linspace(0.0, along[-1], int(np.ceil(along[-1] / STEP_MM)) + 1)
        place = np.column_stack([np.interp(at, along, line[:, x]) for x in range(3)])
        found = (place, np.full(len(at), k), at, np.interp(at, along, line[:, 3]))
        for column, values in zip(dense, found, strict=True):
            column.append(values)
    points, vessel, arc, radius = map(np.concatenate, dense)
    return Axes(ends, node, lines, length, volume, KDTree(points), vessel, arc, radius)


FINEST = 0.3
WINDOW_MM = 0.5
BESIDE_MM = 0.05
BIN_MM = 0.02
OFF_MM = 0.015


@dataclass(frozen=True)
class Ink:
    """Ink as short stretches (n,) in the order of writing; mm.

    ``point``: middle; ``tip``: its end, where the tip stands when it is written; ``move`` of the
    file, ``stroke``: pass; ``arc`` along the pass at the stretch's end. Of the nearest axis:
    ``vessel`` (-1 beside the network, a prime line, say), ``vessel_arc`` along it, ``off_mm`` from
    it, ``design_radius`` there.
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


def written_ink(
    moves: Moves,
    axes: Axes,
    ul_per_e: float,
    longest_mm: float = np.inf,
    window_mm: float = WINDOW_MM,
) -> Ink:
    """Lay the ink: a stretch is at most `FINEST` radii long, and ``longest_mm``.

    Radius from the volume pushed over ``window_mm`` about each place, within its pass: E is written
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
    pushed_by = along, total, ul_per_e, window_mm
    rough = _radius(middle, begin, end, *pushed_by)
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
        radius=_radius(at, begin[of], end[of], *pushed_by),
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
    window_mm: float,
) -> FloatArray:
    places = np.append(0.0, along)
    low = np.clip(at - window_mm / 2, begin, np.maximum(end - window_mm, begin))
    high = np.clip(low + window_mm, begin, end)
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


def vessels_of_passes(ink: Ink, axes: Axes) -> IntArray:
    """Vessel of each stretch; of an overlap at a pass' end the one that the pass writes there."""
    past, rows = _past_joints(ink, axes), np.arange(len(ink.stroke))
    joint = past.copy()  # with the stretch nearest to the node, which may lie on either side
    joint[1:] |= past[:-1]
    joint[:-1] |= past[1:]
    past = joint
    beside = np.flatnonzero(~past)
    at = np.searchsorted(beside, rows)
    own = rows.copy()
    for k in (at, at - 1):
        row = beside[k.clip(0, len(beside) - 1)]
        own = np.where(past & (ink.stroke[row] == ink.stroke), row, own)
    vessel: IntArray = ink.vessel[own]
    return vessel


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
