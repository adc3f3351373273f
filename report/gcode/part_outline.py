"""Compare a layer's printed lines with the design's outline: ink beyond it or short of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from kernels.arrays import FloatArray
from registration.gcode_job import GcodeJob

SPACING_MM: Final = 0.03
"""Along the outline."""

REACH_MM: Final = 0.3
"""An edge of ink farther than this isn't looked for."""


@dataclass(frozen=True, eq=False)
class DesignOutline:
    """The section of the part at the middle of a layer.

    Attributes
    ----------
    rings : tuple of (k, 2) float64, mm
        Closed outlines in the printer's frame, in short pieces: the last point is the first.
    beyond_mm : tuple of (k - 1,) float64, mm
        How far ink reaches beyond the outline at the middle of each piece: into a lumen, or out of
        the part; below 0 where it falls short. -`REACH_MM` where there is none near.
    """

    rings: tuple[FloatArray, ...]
    beyond_mm: tuple[FloatArray, ...]


def design_outline(job: GcodeJob, layer: int, sections: Sequence[FloatArray]) -> DesignOutline:
    """Hold a layer's lines against the part's section.

    Lines are as wide as the picture draws them: bands with round ends. Where lines overlap the
    edge of the one that reaches farthest counts, so that ink far beyond is given too small.

    Parameters
    ----------
    job : GcodeJob
    layer : int
        From 0.
    sections : sequence of (k, 2) float64, mm
        Rings of the part's section at the middle of the layer, in the printer's frame.
    """
    rows = np.flatnonzero((job.layer == layer) & job.writes)
    start, end = job.start[rows, :2], job.end[rows, :2]
    half = np.nan_to_num(job.width_mm[rows]) / 2
    tree = shapely.STRtree(shapely.linestrings(np.stack([start, end], axis=1)))
    rings = tuple(_parted(ring) for ring in sections)
    beyond = []
    for ring in rings:
        middle = 0.5 * (ring[1:] + ring[:-1])
        far_mm = np.full(len(middle), -REACH_MM)
        reach = REACH_MM + float(half.max(initial=0.0))
        at, line = tree.query(shapely.points(middle), predicate="dwithin", distance=reach)
        gap = _distance(middle[at], start[line], end[line])
        np.maximum.at(far_mm, at, half[line] - gap)
        beyond.append(far_mm)
    return DesignOutline(rings, tuple(beyond))


def _parted(ring: FloatArray) -> FloatArray:
    """A closed ring in pieces no longer than `SPACING_MM`."""
    closed = np.concatenate([ring, ring[:1]])
    step = np.diff(closed, axis=0)
    count = np.maximum(np.ceil(np.linalg.norm(step, axis=1) / SPACING_MM), 1.0).astype(np.int64)
    piece = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    points = closed[piece] + (within / count[piece])[:, None] * step[piece]
    return np.concatenate([points, points[:1]])


def _distance(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Of each point from its segment, (n,), mm."""
    way = end - start
    square = np.maximum(np.sum(way * way, axis=1), 1e-30)
    share = np.clip(np.sum((points - start) * way, axis=1) / square, 0.0, 1.0)
    distance: FloatArray = np.linalg.norm(points - start - share[:, None] * way, axis=1)
    return distance
