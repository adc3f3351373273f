"""Volume of a union of tubes, and how far a mesh's facets lie off the exact ones.

Without product code: round-ended cones, by Monte-Carlo sampling.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.networks import Pieces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def capsule_union_volume(net: Pieces, samples: int = 2_000_000) -> tuple[float, float]:
    """Return the volume of a union of cones with half balls at their ends; standard error, mm³.

    Each solid is sampled evenly within; a point that lies in m of them counts 1/m (so the sum
    over all solids counts every place once). No grid, no mesh.
    """
    rng, (radius0, radius1) = np.random.default_rng(0), net.radius.T
    start, axis = net.start, net.end - net.start
    length = np.linalg.norm(axis, axis=1)
    axis = axis / length[:, None]
    cone = np.pi * length * (radius0**2 + radius0 * radius1 + radius1**2) / 3.0
    volume = cone + 2.0 / 3.0 * np.pi * (radius0**3 + radius1**3)
    share = np.maximum(64, np.ceil(samples * volume / volume.sum())).astype(np.int64)
    which = np.repeat(np.arange(len(start)), share)
    points = _inside(rng, which, (start, axis, length, radius0, radius1))
    count = _multiplicity(points, start, axis, length, radius0, radius1)
    weight = 1.0 / np.maximum(count, 1)
    mean = np.bincount(which, weight) / share
    square = np.bincount(which, weight**2) / share - mean**2
    total = float((volume * mean).sum())
    error = float(np.sqrt((volume**2 * np.maximum(square, 0.0) / share).sum()))
    return total, error


def _inside(rng: np.random.Generator, which: IntArray, solid: tuple[FloatArray, ...]) -> FloatArray:
    """Points even within their solids: drawn in the cylinder around, kept when inside."""
    start, axis, length, radius0, radius1 = (part[which] for part in solid)
    wide = np.maximum(radius0, radius1)
    helper = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(axis, first)
    points = np.empty_like(start)
    left = np.arange(len(which))
    while len(left):
        s = rng.uniform(-radius0[left], length[left] + radius1[left])
        angle = rng.uniform(0, 2 * np.pi, len(left))
        away = wide[left] * np.sqrt(rng.random(len(left)))
        slope = (radius1[left] - radius0[left]) / length[left]
        room = radius0[left] + slope * np.clip(s, 0, length[left])
        over = np.maximum(np.maximum(-s, s - length[left]), 0.0)
        kept = away**2 + over**2 <= room**2
        at, x, y = left[kept], away[kept] * np.cos(angle[kept]), away[kept] * np.sin(angle[kept])
        points[at] = start[at] + s[kept, None] * axis[at] + x[:, None] * first[at]
        points[at] += y[:, None] * second[at]
        left = left[~kept]
    return points


def _multiplicity(
    points: FloatArray,
    start: FloatArray,
    axis: FloatArray,
    length: FloatArray,
    radius0: FloatArray,
    radius1: FloatArray,
) -> IntArray:
    """In how many of the solids each point lies; solids are cut short so that a ball holds each."""
    piece = np.maximum(1, np.ceil(length / (2.0 * np.maximum(radius0, radius1)))).astype(np.int64)
    solid = np.repeat(np.arange(len(start)), piece)
    number = np.arange(len(solid)) - np.repeat(np.cumsum(piece) - piece, piece)
    half = 0.5 * (length / piece)[solid]
    middle = start[solid] + ((2 * number + 1) * half)[:, None] * axis[solid]
    reach = half + np.maximum(radius0, radius1)[solid]
    count = np.zeros(len(points), dtype=np.int64)
    tree = cKDTree(points)
    for begin in range(0, len(solid), 2000):
        part = slice(begin, begin + 2000)
        near = tree.query_ball_point(middle[part], reach[part])
        sizes = np.array([len(one) for one in near])
        if sizes.sum() == 0:
            continue
        at = np.concatenate([np.asarray(one, dtype=np.int64) for one in near])
        k = np.repeat(solid[part], sizes)
        here = np.repeat(number[part], sizes)
        s = np.einsum("ij,ij->i", points[at] - start[k], axis[k])
        # Each place along the axis belongs to one piece, so that none counts a point twice.
        own = np.clip(s * (piece / length)[k], 0, piece[k] - 1).astype(np.int64) == here
        foot = np.clip(s, 0.0, length[k])
        gap = np.linalg.norm(points[at] - start[k] - foot[:, None] * axis[k], axis=1)
        radius = radius0[k] + (radius1 - radius0)[k] * foot / length[k]
        np.add.at(count, at[own & (gap <= radius)], 1)
    return count


def facet_deviations(corners: FloatArray, net: Pieces, samples: int = 40_000) -> FloatArray:
    """Return distances of points on triangles (f, 3, 3) from the exact surface, over radius, (n,).

    Half of the points are even in area, so that tubes count; half are one each of faces drawn at
    random, so that junctions and ends, which have most faces, count. The radius is that of the
    solid that the point belongs to.
    """
    rng, (a, b, c) = np.random.default_rng(0), np.moveaxis(corners, 1, 0)
    area, half = np.linalg.norm(np.cross(b - a, c - a), axis=1), samples // 2
    even = rng.choice(len(corners), half, p=area / area.sum())
    face = np.append(even, rng.integers(0, len(corners), samples - half))
    one, two = rng.random((2, samples, 1))
    turned = one + two > 1.0
    one, two = np.where(turned, 1.0 - one, one), np.where(turned, 1.0 - two, two)
    points = a[face] + one * (b - a)[face] + two * (c - a)[face]
    found: FloatArray = _nearest(points, net.start, net.end, np.ascontiguousarray(net.radius))
    return found


@compiled
def _nearest(
    points: FloatArray, start: FloatArray, end: FloatArray, radius: FloatArray
) -> FloatArray:
    found = np.empty(len(points))
    for n in range(len(points)):
        best, wide = np.inf, 1.0
        x, y, z = points[n]
        for m in range(len(start)):
            ax, ay, az = (end[m, 0] - start[m, 0], end[m, 1] - start[m, 1], end[m, 2] - start[m, 2])
            px, py, pz = x - start[m, 0], y - start[m, 1], z - start[m, 2]
            along = (px * ax + py * ay + pz * az) / (ax * ax + ay * ay + az * az)
            along = min(1.0, max(0.0, along))
            here = radius[m, 0] + along * (radius[m, 1] - radius[m, 0])
            px, py, pz = px - along * ax, py - along * ay, pz - along * az
            away = np.sqrt(px * px + py * py + pz * pz) - here
            if away < best:
                best, wide = away, here
        found[n] = best / wide
    return found
