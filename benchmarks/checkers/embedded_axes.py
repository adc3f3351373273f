"""Vessel axes that an embedded print should follow, and the nearest vessel of each point."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.read_network import read_network

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
STEP_MM = 0.04
TRIED = 6


@dataclass(frozen=True)
class Axes:
    """Vessels as polylines, and dense points along them.

    Attributes
    ----------
    ends : (v, 2) int64
        Nodes at the first and the last point of each vessel.
    node : (m, 3) float64, mm
    lines : list of (k, 4) float64, mm
        Points and radius of each vessel.
    length : (v,) float64, mm
    volume_ul : float
        Of all vessels as frustums, joints counted for each vessel that meets there.
    tree : KDTree
        Of the dense points.
    vessel : (p,) int64
    arc, radius : (p,) float64, mm
        Of each dense point.
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

    def degree(self) -> IntArray:
        """Vessels' ends at each node."""
        return np.bincount(self.ends.ravel(), minlength=len(self.node))


def arcs(points: FloatArray) -> FloatArray:
    """Arc length at each point of a polyline, mm."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def read_axes(path: Path, scale: float = 1.0) -> Axes:
    """Read a `network.csv`, mm, scaled as it is printed.

    Raises
    ------
    ValueError
        When the pieces of a vessel aren't in their order.
    """
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
        points = np.vstack([pieces.start[low:high], pieces.end[high - 1]]) * scale
        radius = np.append(pieces.radius[low:high, 0], pieces.radius[high - 1, 1]) * scale
        lines.append(np.column_stack([points, radius]))
        ends.append((pieces.node[low, 0], pieces.node[high - 1, 1]))
        node[pieces.node[low, 0]], node[pieces.node[high - 1, 1]] = points[0], points[-1]
    r0, r1 = pieces.radius.T * scale
    volume = np.pi / 3 * (pieces.length * scale * (r0 * r0 + r0 * r1 + r1 * r1)).sum()
    return _dense(np.array(ends), node, lines, float(volume))


def _dense(ends: IntArray, node: FloatArray, lines: list[FloatArray], volume: float) -> Axes:
    points, vessel, arc, radius = [], [], [], []
    length = np.zeros(len(lines))
    for k, line in enumerate(lines):
        along = arcs(line[:, :3])
        length[k] = along[-1]
        at = np.linspace(0.0, along[-1], int(np.ceil(along[-1] / STEP_MM)) + 1)
        points.append(np.column_stack([np.interp(at, along, line[:, x]) for x in range(3)]))
        vessel.append(np.full(len(at), k))
        arc.append(at)
        radius.append(np.interp(at, along, line[:, 3]))
    return Axes(
        ends,
        node,
        lines,
        length,
        volume,
        KDTree(np.concatenate(points)),
        np.concatenate(vessel),
        np.concatenate(arc),
        np.concatenate(radius),
    )
