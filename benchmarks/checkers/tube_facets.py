"""Distance of a lumen's facets from the exact round tubes, over each tube's radius.

Shares no code with the product. The exact surface is that of cones with half balls at their ends,
the union of all; a point's distance from it is the least of those from each solid, negative
inside. Every solid is asked for every point: slow, and nothing to get wrong.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.read_network import Pieces

FloatArray = NDArray[np.float64]


def facet_deviations(
    corners: FloatArray, pieces: Pieces, samples: int = 40_000, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Distances of points on triangles (f, 3, 3) from the exact surface, (n,), mm; and over radius.

    Half of the points are even in area, so that tubes count; half are one each of faces drawn at
    random, so that junctions and ends, which have most faces, count. The radius is that of the
    solid that the point belongs to.
    """
    rng = np.random.default_rng(seed)
    a, b, c = (corners[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    face = np.r_[
        rng.choice(len(corners), samples // 2, p=area / area.sum()),
        rng.integers(0, len(corners), samples - samples // 2),
    ]
    one, two = rng.random((2, samples))
    turned = one + two > 1.0
    one, two = np.where(turned, 1.0 - one, one)[:, None], np.where(turned, 1.0 - two, two)[:, None]
    points = a[face] + one * (b - a)[face] + two * (c - a)[face]
    gap, radius = np.empty(samples), np.empty(samples)
    _nearest(points, pieces.start, pieces.end, np.ascontiguousarray(pieces.radius), gap, radius)
    return gap, gap / radius


@compiled
def _nearest(
    points: FloatArray,
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    gap: FloatArray,
    own: FloatArray,
) -> None:
    for n in range(len(points)):
        best, wide = np.inf, 0.0
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
        gap[n], own[n] = best, wide
