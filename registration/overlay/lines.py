"""Split a layered G-code job into layers of written lines, in the part's frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath.correction import Stretch
from kernels.arrays import FloatArray, IntArray
from registration.gcode_job import Act, GcodeJob

Mask = NDArray[np.bool_]

_SAME_MM: Final = 2e-3
"""Ends nearer than this are one place: a G-code file rounds to a micron."""


@dataclass(frozen=True, eq=False)
class LayerLines:
    """What one layer writes, seen from above.

    Attributes
    ----------
    number : int
        From 1, the lowest.
    low_mm, high_mm : float, mm
        Between which heights of the part the layer lies.
    start, end : (n, 2) float64, mm
        Of the moves that write, in their order, part frame.
    width_mm : (n,) float64, mm
        Of each written line.
    line : (n,) int64
        Of the G-code file, from 1.
    joined : (n,) bool
        Whether the move goes on where the one before it ended.
    closed : (n,) bool
        Whether the line that the move is of comes back to where it began: a wall.
    travel : (m, 2, 2) float64, mm
        Ways without ink, start and end.
    """

    number: int
    low_mm: float
    high_mm: float
    start: FloatArray
    end: FloatArray
    width_mm: FloatArray
    line: IntArray
    joined: Mask
    closed: Mask
    travel: FloatArray

    @property
    def middle_mm(self) -> float:
        """Height at which a scan is cut to be held against the layer, mm."""
        return (self.low_mm + self.high_mm) / 2

    def upto(self, count: int) -> LayerLines:
        """The same layer with its first so many moves, and no travels."""
        return replace(
            self,
            start=self.start[:count],
            end=self.end[:count],
            width_mm=self.width_mm[:count],
            line=self.line[:count],
            joined=self.joined[:count],
            closed=self.closed[:count],
            travel=self.travel[:0],
        )


def layers_of(
    job: GcodeJob, place_mm: FloatArray, stretch: Stretch | None = None
) -> tuple[LayerLines, ...]:
    """All layers of a layered job, the lowest first.

    Parameters
    ----------
    job : GcodeJob
        Layered, with known line widths.
    place_mm : (3,) float64, mm
        Part to printer.
    stretch : Stretch or None
        Designed to written size, taken back: what lines are laid over has the designed one.
    """
    stretch = stretch or Stretch()
    order = np.argsort(job.layer, kind="stable")
    count = len(job.layers)
    at = np.searchsorted(job.layer[order], np.arange(count + 1))
    return tuple(_layer(job, k, order[at[k] : at[k + 1]], place_mm, stretch) for k in range(count))


def _layer(
    job: GcodeJob, index: int, rows: IntArray, place_mm: FloatArray, stretch: Stretch
) -> LayerLines:
    start, end = (stretch.back(way[rows] - place_mm)[:, :2] for way in (job.start, job.end))
    writes = job.writes[rows]
    joined = np.concatenate([[False], writes[:-1] & (np.diff(rows) == 1)])[writes]
    level = np.isin(job.act[rows], (Act.TRAVEL, Act.LIFTED, Act.WIPE))
    written = np.array([[0.0, 0.0, float(job.layers.z_mm[index]) - float(place_mm[2])]])
    top, height = float(stretch.back(written)[0, 2]), float(job.layers.height_mm[index])
    return LayerLines(
        number=index + 1,
        low_mm=top - height / stretch.factor[2],
        high_mm=top,
        start=start[writes],
        end=end[writes],
        width_mm=job.width_mm[rows][writes],
        line=job.line[rows][writes],
        joined=joined,
        closed=_closed(start[writes], end[writes], joined),
        travel=np.stack([start[level], end[level]], axis=1),
    )


def _closed(start: FloatArray, end: FloatArray, joined: Mask) -> Mask:
    """Of each move, whether its run of joined moves ends where it began."""
    first = np.flatnonzero(~joined)
    last = np.append(first[1:], len(joined)) - 1
    apart = np.linalg.norm(end[last] - start[first], axis=1)
    # There and back again on one line encloses nothing.
    loop = (apart < _SAME_MM) & (last - first >= 2)
    return np.repeat(loop, last - first + 1)
