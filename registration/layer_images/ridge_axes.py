"""Nearest middles of fresh lines, of all of them or without a stretch of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from registration.layer_images.values import BoolArray, ExpectedLines, FloatArray, IntArray
from registration.layer_images.ways import from_stroke_begin

_APART: Final = 0.15
"""Widths between the points that stand for lines, at most."""


Nearest = Callable[[FloatArray], tuple[FloatArray, BoolArray]]
"""Vectors to places from the nearest line's middle, mm, and whether any is near."""


@dataclass(frozen=True)
class Axes:
    """Points along the middles of fresh lines, each of which stands for the piece around it.

    Attributes
    ----------
    tree : cKDTree
        Of (m, 2) points, mm.
    ahead : (m, 2) float64
        Way of the line, a unit vector.
    piece : (m, 2) float64, mm
        From where to where along it a point stands for the line: as far as half way to the next.
    stroke : (m,) int64
    along : (m,) float64, mm
        From the stroke's begin.
    step_mm : float, mm
        Between neighbours, at most.
    """

    tree: cKDTree
    ahead: FloatArray
    piece: FloatArray
    stroke: IntArray
    along: FloatArray
    step_mm: float

    @staticmethod
    def of(lines: ExpectedLines) -> Axes:
        """Lay points along all fresh lines, their ends included."""
        step = _APART * float(np.median(lines.width_mm[lines.fresh]))
        way = lines.end - lines.start
        length = np.linalg.norm(way, axis=1)
        begin = from_stroke_begin(lines.stroke, length)
        rows = np.flatnonzero(lines.fresh)
        count = np.maximum(2, np.ceil(length[rows] / step).astype(np.int64) + 1)
        own = np.repeat(rows, count)
        share = np.concatenate([np.linspace(0.0, 1.0, n) for n in count])
        at = lines.start[own, :2] + share[:, None] * way[own, :2]
        flat = np.linalg.norm(way[own, :2], axis=1)
        half = 0.5 * flat / np.repeat(count - 1, count)
        piece = np.column_stack([np.where(share > 0, -half, 0.0), np.where(share < 1, half, 0.0)])
        ahead = way[own, :2] / np.maximum(flat, 1e-9)[:, None]
        along = begin[own] + share * length[own]
        return Axes(cKDTree(at), ahead, piece, lines.stroke[own], along, step)

    def nearest(self, at: FloatArray, within_mm: float) -> tuple[FloatArray, BoolArray]:
        """Vectors to places (k, 2) from the nearest line, mm, and whether one is so near, (k,)."""
        far, row = self.tree.query(at, distance_upper_bound=within_mm)
        near = np.isfinite(far)
        return self._from_line(at, np.where(near, row, 0)), np.asarray(near)

    def nearest_other(
        self, at: FloatArray, stroke: IntArray, along: FloatArray, apart_mm: float, within_mm: float
    ) -> tuple[FloatArray, BoolArray]:
        """The same from the nearest line that isn't within ``apart_mm`` along its own stroke."""
        count = min(int(2.0 * apart_mm / self.step_mm) + 4, len(self.along))
        far, row = self.tree.query(at, k=count, distance_upper_bound=within_mm)
        near = np.isfinite(far)
        row = np.where(near, row, 0)
        own = self.stroke[row] == stroke[:, None]
        other = near & ~(own & (np.abs(self.along[row] - along[:, None]) < apart_mm))
        found = row[np.arange(len(at)), other.argmax(axis=1)]
        return self._from_line(at, found), other.any(axis=1)

    def _from_line(self, at: FloatArray, row: IntArray) -> FloatArray:
        """Vectors to places from the piece around a point, mm."""
        off, ahead = at - self.tree.data[row], self.ahead[row]
        t = np.clip(np.einsum("ij,ij->i", off, ahead), *self.piece[row].T)
        return np.asarray(off - t[:, None] * ahead)
