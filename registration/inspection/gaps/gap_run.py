"""Samples along the run of places that a gap lies on, where its ends are looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.values import Gap
from registration.inspection.ways import Ways

FINE: Final = 3
"""Samples in a pixel."""
_BEYOND: Final = 2.5
"""Widths of ink beside a gap that are looked at."""
_ALONE: Final = 0.8
"""Of the places about a gap whose both sides are free."""


@dataclass(frozen=True)
class GapRun:
    """A gap and what lies about it on its stroke.

    Attributes
    ----------
    gap : Gap
    ways : Ways
    rows : (m,) int64
        Places of the unbroken run that the gap lies on.
    s : (k,) float64, mm
        Samples along the stroke.
    width_mm : float, mm
    """

    gap: Gap
    ways: Ways
    rows: IntArray
    s: FloatArray
    width_mm: float

    @staticmethod
    def of(gap: Gap, ways: Ways, px_mm: float) -> GapRun | None:
        """Sample it; None where too little lies about the gap."""
        rows = np.flatnonzero(ways.stroke == gap.stroke)
        off = np.abs(ways.along[rows] - 0.5 * (gap.from_mm + gap.to_mm))
        rows = rows[ways.run[rows] == ways.run[rows[off.argmin()]]]
        along, width = ways.along[rows], float(ways.width[rows].max())
        reach = _BEYOND * width
        low, high = max(gap.from_mm - reach, along[0]), min(gap.to_mm + reach, along[-1])
        s = np.arange(low, high, px_mm / FINE)
        return None if len(s) < 4 * FINE else GapRun(gap, ways, rows, s, width)

    def has_ink(self, ink: BoolArray) -> BoolArray:
        """Which samples lie between places with ``ink`` (n,), (k,)."""
        along = self.ways.along[self.rows]
        return np.asarray(np.interp(self.s, along, ink[self.rows].astype(np.float64)) > 0.99)

    def is_alone(self, free: BoolArray) -> bool:
        """Whether both sides of the line are ``free`` (n,) about the gap."""
        gap, along = self.gap, self.ways.along[self.rows]
        off = np.abs(along - 0.5 * (gap.from_mm + gap.to_mm))
        near = off < 0.5 * gap.length_mm + self.width_mm
        return bool(free[self.rows][near].mean() > _ALONE)

    def with_ends(self, ends_mm: Sequence[float], u_mm: float) -> Gap:
        """Return the gap with other ends along the stroke; as it was where none is left."""
        begin, end = ends_mm
        if end <= begin:
            return self.gap
        along, at = self.ways.along[self.rows], self.ways.point[self.rows]
        start_mm, end_mm = (
            (float(np.interp(one, along, at[:, 0])), float(np.interp(one, along, at[:, 1])))
            for one in (begin, end)
        )
        return replace(
            self.gap, from_mm=begin, to_mm=end, start_mm=start_mm, end_mm=end_mm, u_tip_mm=u_mm
        )
