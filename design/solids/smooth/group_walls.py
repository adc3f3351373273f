"""Collect the walls and fixed end rings of a group of overlapping vessels, to be rounded."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from design.solids.facets import area_factor
from design.solids.smooth.fillet import wall_rows
from design.solids.smooth.layout import Layout, first_piece
from design.solids.smooth.round_seams import Rounding
from design.solids.tube import EndShape
from kernels.arrays import FloatArray

_BEYOND_RING = 4.0
"""Radii of the plain tube beyond a group's ring that the ball can touch."""


def crowd_rounding(
    layout: Layout,
    joints: list[int],
    runs: list[int],
    shapes: list[tuple[EndShape, EndShape]],
    tolerance_mm: float,
) -> Rounding:
    """Walls and fixed ends of a group of ``joints`` and absorbed ``runs``."""
    pieces: list[tuple[FloatArray, FloatArray, float, float, float]] = []
    ends: list[FloatArray] = []
    for run in runs:
        pieces += list(_pieces(layout, run))
        for end in (0, 1):
            if shapes[run][end] == "flat" and (run, end) not in layout.joint_of():
                start, axis, _, radius, _ = first_piece(layout.runs[run], end)
                ends.append(np.array([*start, *axis, 1.05 * radius]))
    for joint in joints:
        for run, end in layout.ends[joint]:
            if layout.swallowed[run]:
                continue
            start, axis, length, radius, slope = first_piece(layout.runs[run], end)
            reach, wide = layout.reach[run, end], area_factor(layout.facets[run])
            goes_on = min(length, reach + _BEYOND_RING * radius)
            pieces.append((start, axis, goes_on, wide * radius, wide * slope))
            at_ring = 1.05 * (radius + slope * reach)
            ends.append(np.array([*(start + reach * axis), *axis, at_ring]))
    columns = [np.array(column) for column in zip(*pieces, strict=True)]
    lengths, radii, slopes = columns[2:]
    thinnest = np.minimum(radii, radii + slopes * lengths)
    asked = layout.fillet_mm
    rho = layout.fillet_ratio * thinnest if asked is None else np.full(len(radii), asked)
    rows = wall_rows(columns[0], columns[1], lengths, radii, slopes)
    return Rounding(rows, rho, np.reshape(np.array(ends), (-1, 7)), tolerance_mm)


def _pieces(
    layout: Layout, run: int
) -> Iterator[tuple[FloatArray, FloatArray, float, float, float]]:
    """Start, axis, length, radius and slope of each piece of a swallowed run."""
    chain, wide = layout.runs[run], area_factor(layout.facets[run])
    step = np.diff(chain.points, axis=0)
    for k, length in enumerate(np.linalg.norm(step, axis=1).tolist()):
        radius, slope = wide * chain.radius[k], wide * (chain.radius[k + 1] - chain.radius[k])
        yield chain.points[k], step[k] / length, length, float(radius), float(slope / length)
