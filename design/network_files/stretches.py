"""Find stretches over which one polyline runs along others, as lines through one lumen do."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label
from scipy.spatial import cKDTree

from design.geometry.polyline import places_along
from kernels.arrays import FloatArray, IntArray


class MergeLimits(NamedTuple):
    """When axes belong to one lumen; lengths and distances in radii."""

    # Nearer axes are one lumen's: lines traced twice through a lumen differ less, axes of vessels
    # that touch are both radii apart. From 0.28 to 0.5 the cases of `test_merge.py` read alike.
    same_axis: float = 0.35
    bridged: float = 0.7  # between two stretches, without the stretch being broken
    coincident: float = 0.02  # lines nearer than this are at the same place, for where they part
    length: float = 2.0  # over which axes must be so near; half of it where they coincide
    alike: float = 1.5  # ratio of radii up to which lines that don't coincide are one lumen's
    parallel: float = 0.7  # cosine from which two straight pieces can run along each other
    # Between two stretches of one lumen a nearer axis hasn't left it: chords of coarse lines cut
    # corners, most between given points. Two vessels that touch are two radii apart.
    in_lumen: float = 1.25
    chord: float = 3.0
    # To a joint of two vessels, within which a line that goes over from one to the other makes no
    # way of its own.
    joint_reach: float = 6.0
    near_end: float = 0.5  # a joint nearer to an end, or to another joint, is there
    near_point: float = 0.05  # a joint goes to a point of the line that is nearer
    falling: float = 0.8  # a distance that falls less within a radius is as usual for the lines
    reported_difference: float = 0.05  # of merged vessels' radii, over the radius


LIMITS: Final = MergeLimits()


_SAMPLE_SPACING: Final = 0.25
"""Of samples, in radii."""
_PIECE_SAMPLES: Final = 1000
"""Of a straight piece, at most."""
_CANDIDATES: Final = 8
"""Stretches whose middles are nearest, among which the nearest foot is looked for."""


class Samples(NamedTuple):
    """Points of a polyline, and others between them a quarter of a radius apart."""

    at: FloatArray  # (n,), place along the polyline, counted in its points
    points: FloatArray  # (n, 3), mm
    radius: FloatArray  # (n,), mm
    length: FloatArray  # (n,), way from the first, mm
    ends: FloatArray  # (2, 3), mm


class Feet(NamedTuple):
    """Nearest place on other polylines, for each sample."""

    path: IntArray  # (n,), number of the polyline
    at: FloatArray  # (n,), place along it, counted in its points
    points: FloatArray  # (n, 3), mm
    radius: FloatArray  # (n,), mm
    gap: FloatArray  # (n,), distance from the sample, mm
    to_end: FloatArray  # (n,), distance from the polyline's nearer end, mm


class Stretch(NamedTuple):
    """Samples ``first`` to ``last`` of a polyline, which run along others; lengths in mm."""

    first: int
    last: int
    length: float
    gap: float  # between the axes, at most
    gap_ratio: float  # over the radius, at most
    radius_difference: float  # over the radius, at most
    opposed: bool  # whether the polylines have opposite directions


def sample(points: FloatArray, radius: FloatArray) -> Samples:
    """Sample a polyline, and its radius in between, at a share of its radius apart."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    spacing = _SAMPLE_SPACING * np.minimum(radius[:-1], radius[1:])
    count = np.clip(np.ceil(step / spacing), 1, _PIECE_SAMPLES).astype(np.int64)
    piece = np.repeat(np.arange(len(step)), count)
    part = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)) / count[piece]
    at = np.r_[piece + part, float(len(step))]
    index = np.arange(len(points), dtype=np.float64)
    known = np.column_stack([points, radius, np.r_[0.0, np.cumsum(step)]])
    values = places_along(known, index, at)
    return Samples(at, values[:, :3], values[:, 3], values[:, 4], points[[0, -1]])


def nearest_feet(own: Samples, others: list[Samples]) -> Feet:
    """Find each sample's nearest point on the other polylines, whichever it is on."""
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
    """Stretches over which samples run along other polylines, in their order.

    ``at_node`` says whether the polyline's first and last end are nodes of those that it may run
    along. If both are and it is near them all the way, its length doesn't matter. From a node that
    they share, vessels that only diverge are a bifurcation's, however slowly they do.
    """
    radius = np.minimum(own.radius, feet.radius)
    alike = np.maximum(own.radius, feet.radius) <= LIMITS.alike * radius
    near = (feet.gap <= LIMITS.same_axis * radius) & _advancing(own.points, feet.points)
    near &= alike | (feet.gap <= LIMITS.coincident * radius)
    number, count = label(near | (feet.gap <= LIMITS.bridged * radius))
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
        least = LIMITS.length * float(np.median(radius[span]))
        if (feet.gap[span] <= LIMITS.coincident * radius[span]).all():
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
    ended = feet.to_end <= LIMITS.near_end * radius
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
    while ratio[k] > LIMITS.coincident and k + 1 < len(ratio):
        end = max(k + 2, int(np.searchsorted(way, way[k] + radius)))
        step = int(np.argmin(ratio[k + 1 : end]))
        if ratio[k + 1 + step] > LIMITS.falling * ratio[k]:
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
