"""Find stretches over which one polyline runs along others, as lines through one lumen do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import cKDTree

from kernels.arrays import FloatArray, IntArray

SAME_AXIS: Final = 0.35
"""Axes nearer than so many radii are one lumen's. Lines traced twice through a lumen differ less,
and axes of separate vessels that touch are the sum of both radii apart. From 0.28 to 0.5 the cases
of `tests/design/network_files/test_merge.py` read alike."""
NEAR_END: Final = 0.5
"""A joint nearer than so many radii to an end, or to another joint, is there."""

_LEAST_LENGTH: Final = 2.0
"""Radii over which axes must be so near, not counting where they part from each other; half of
that where they coincide."""
_ALIKE: Final = 1.5
"""Ratio of radii up to which lines that don't coincide are one lumen's."""
_BRIDGED: Final = 2 * SAME_AXIS
"""Between two stretches axes may be this many radii apart without the stretch being broken."""
_COINCIDENT: Final = 0.02
"""Lines nearer than so many radii are at the same place, for where they part."""
_SPACING: Final = 0.25
"""Of samples, in radii."""
_FALLING: Final = 0.8
"""A distance that doesn't fall to this part of itself within a radius is as usual for the lines."""
_PIECE_SAMPLES: Final = 1000
_CANDIDATES: Final = 8


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of a polyline, and others between them a quarter of a radius apart.

    Attributes
    ----------
    at : (n,) float64
        Place along the polyline, counted in its points.
    points : (n, 3) float64, mm
    radius : (n,) float64, mm
    length : (n,) float64, mm
        Way from the first.
    ends : (2, 3) float64, mm
    """

    at: FloatArray
    points: FloatArray
    radius: FloatArray
    length: FloatArray
    ends: FloatArray


class Feet(NamedTuple):
    """Nearest place on other polylines, for each sample.

    Attributes
    ----------
    path : (n,) int64
        Number of the polyline.
    at : (n,) float64
        Place along it, counted in its points.
    points : (n, 3) float64, mm
    radius : (n,) float64, mm
    gap : (n,) float64, mm
        Distance from the sample.
    to_end : (n,) float64, mm
        Distance from the polyline's nearer end.
    """

    path: IntArray
    at: FloatArray
    points: FloatArray
    radius: FloatArray
    gap: FloatArray
    to_end: FloatArray


@dataclass(frozen=True)
class Stretch:
    """Samples ``first`` to ``last`` of a polyline, which run along others.

    Attributes
    ----------
    length, gap : float, mm
        Of the stretch, and between the axes at most.
    gap_ratio, radius_difference : float
        The gap over the radius, and how far radii differ over the radius, at most.
    opposed : bool
        Whether the polylines have opposite directions.
    """

    first: int
    last: int
    length: float
    gap: float
    gap_ratio: float
    radius_difference: float
    opposed: bool


def sample(points: FloatArray, radius: FloatArray) -> Samples:
    """Return samples of a polyline with ``points`` (k, 3) and ``radius`` (k,), mm."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    spacing = _SPACING * np.minimum(radius[:-1], radius[1:])
    count = np.clip(np.ceil(step / spacing), 1, _PIECE_SAMPLES).astype(np.int64)
    piece = np.repeat(np.arange(len(step)), count)
    part = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)) / count[piece]
    at = np.r_[piece + part, float(len(step))]
    index = np.arange(len(points), dtype=np.float64)
    known = np.column_stack([points, radius, np.r_[0.0, np.cumsum(step)]])
    values = np.stack([np.interp(at, index, column) for column in known.T], axis=1)
    return Samples(at, values[:, :3], values[:, 3], values[:, 4], points[[0, -1]])


def nearest_feet(own: Samples, others: list[Samples]) -> Feet:
    """Return the nearest place on the polylines of ``others`` for each sample of ``own``."""
    path = np.repeat(np.arange(len(others)), [len(one.at) - 1 for one in others])
    start, end = (
        np.concatenate([one.points[k : len(one.at) - 1 + k] for one in others]) for k in (0, 1)
    )
    r0, r1 = (
        np.concatenate([one.radius[k : len(one.at) - 1 + k] for one in others]) for k in (0, 1)
    )
    at0, at1 = (np.concatenate([one.at[k : len(one.at) - 1 + k] for one in others]) for k in (0, 1))
    tree = cKDTree((start + end) / 2)
    _, rows = tree.query(own.points, k=min(_CANDIDATES, len(start)))
    rows = rows.reshape(len(own.at), -1)
    way = (end - start)[rows]
    square = np.maximum(np.einsum("ijk,ijk->ij", way, way), 1e-300)
    part = np.einsum("ijk,ijk->ij", own.points[:, None] - start[rows], way) / square
    part = part.clip(0.0, 1.0)
    foot = start[rows] + part[:, :, None] * way
    gap = np.linalg.norm(own.points[:, None] - foot, axis=2)
    each = np.arange(len(rows))
    best = np.argmin(gap, axis=1)
    row, part, foot = rows[each, best], part[each, best], foot[each, best]
    ends = np.array([one.ends for one in others])[path[row]]
    return Feet(
        path=path[row],
        at=at0[row] + part * (at1 - at0)[row],
        points=foot,
        radius=r0[row] + part * (r1 - r0)[row],
        gap=gap[each, best],
        to_end=np.linalg.norm(foot[:, None] - ends, axis=2).min(axis=1),
    )


def shared_stretches(own: Samples, feet: Feet, *, at_node: tuple[bool, bool]) -> list[Stretch]:
    """Return the stretches over which samples run along other polylines, in their order.

    Parameters
    ----------
    own : Samples
    feet : Feet
        Of these samples.
    at_node : (bool, bool)
        Whether the polyline's first and last end are nodes of those that it may run along. If both
        are and it is near them all the way, its length doesn't matter. From a node that they share,
        vessels that only diverge are a bifurcation's, however slowly they do.
    """
    radius = np.minimum(own.radius, feet.radius)
    alike = np.maximum(own.radius, feet.radius) <= _ALIKE * radius
    near = (feet.gap <= SAME_AXIS * radius) & _advancing(own.points, feet.points)
    near &= alike | (feet.gap <= _COINCIDENT * radius)
    number, count = label(near | (feet.gap <= _BRIDGED * radius))
    stretches = []
    for run in range(1, count + 1):
        rows = np.flatnonzero(near & (number == run))
        if not len(rows):
            continue
        first, last = int(rows[0]), int(rows[-1])
        begins, ends = at_node[0] and first == 0, at_node[1] and last == len(near) - 1
        whole = begins and ends
        if not whole:
            rises = np.diff(feet.gap[first : last + 1])
            if (begins and (rises > 0.0).all()) or (ends and (rises < 0.0).all()):
                continue
            first, last = _parting(own, feet, radius, first, last)
        span = slice(first, last + 1)
        least = _LEAST_LENGTH * float(np.median(radius[span]))
        if (feet.gap[span] <= _COINCIDENT * radius[span]).all():
            least /= 2
        if whole or own.length[last] - own.length[first] >= least:
            stretches.append(_stretch(own, feet, radius, first, last))
    return stretches


def _advancing(points: FloatArray, feet: FloatArray) -> NDArray[np.bool_]:
    """Whether feet move along with their samples, not across and not stuck at an end."""
    after = np.r_[1 : len(points), len(points) - 1]
    before = np.r_[0, 0 : len(points) - 1]
    moved = np.linalg.norm(feet[after] - feet[before], axis=1)
    return moved >= 0.5 * np.linalg.norm(points[after] - points[before], axis=1)


def _parting(
    own: Samples, feet: Feet, radius: FloatArray, first: int, last: int
) -> tuple[int, int]:
    """Stretch without the ends in which the lines part from each other.

    Lines part from where the distance between them begins to rise. Where one of them ends, they
    don't part.
    """
    ended = feet.to_end <= NEAR_END * radius
    ratio = feet.gap / radius
    if first > 0 and not ended[first]:
        first += _lowest(ratio[first : last + 1], own.length[first : last + 1], radius[first])
    if last < len(radius) - 1 and not ended[last]:
        back = slice(last, first - 1 if first else None, -1)
        last -= _lowest(ratio[back], own.length[last] - own.length[back], radius[last])
    return first, last


def _lowest(ratio: FloatArray, way: FloatArray, radius: float) -> int:
    """Index to which ratios fall, from the first one on; rises within a radius are passed over."""
    k = 0
    while ratio[k] > _COINCIDENT and k + 1 < len(ratio):
        end = max(k + 2, int(np.searchsorted(way, way[k] + radius)))
        step = int(np.argmin(ratio[k + 1 : end]))
        if ratio[k + 1 + step] > _FALLING * ratio[k]:
            break
        k += 1 + step
    return k


def _stretch(own: Samples, feet: Feet, radius: FloatArray, first: int, last: int) -> Stretch:
    span = slice(first, last + 1)
    same = np.diff(feet.path[span]) == 0
    return Stretch(
        first=first,
        last=last,
        length=float(own.length[last] - own.length[first]),
        gap=float(feet.gap[span].max()),
        gap_ratio=float((feet.gap / radius)[span].max()),
        radius_difference=float((np.abs(own.radius - feet.radius) / radius)[span].max()),
        opposed=bool(np.diff(feet.at[span])[same].sum() < 0.0),
    )
