"""Blobs of cubes, as scanners' programs write them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, label

from benchmarks.supply_bench.solids import Solid, volume_of

_SIDES = [
    ((1, 0, 0), [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)]),
    ((-1, 0, 0), [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)]),
    ((0, 1, 0), [(0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)]),
    ((0, -1, 0), [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]),
    ((0, 0, 1), [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]),
    ((0, 0, -1), [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)]),
]


def blobs(rng: np.random.Generator) -> tuple[Solid, list[Solid]]:
    """The surface of random voxels of 2 mm, and each part's; parts meet in edges and corners.

    Parts of fewer than six voxels are left out.
    """
    size = int(rng.integers(6, 10))
    field = gaussian_filter(rng.normal(size=(size,) * 3), 1.0)
    field /= field.std()
    full = np.pad(field > rng.uniform(0.2, 0.8), 1)
    number, count = label(full)
    for n in range(1, count + 1):
        if (number == n).sum() < 6:
            number[number == n] = 0
    number, count = label(number > 0)
    parts = [_surface(number == n + 1, 2.0) for n in range(count)]
    return _surface(number > 0, 2.0), sorted(parts, key=volume_of, reverse=True)


def _surface(full: np.ndarray, pitch: float) -> Solid:
    """Two triangles for each side of a voxel that has none beside it."""
    corners = []
    for way, quad in _SIDES:
        beside = np.roll(full, [-w for w in way], axis=(0, 1, 2))
        at = np.argwhere(full & ~beside)
        for order in ((0, 1, 2), (0, 2, 3)):
            corners.append(at[:, None] + np.array([quad[k] for k in order])[None])
    flat = np.concatenate(corners).reshape(-1, 3)
    points, faces = np.unique(flat, axis=0, return_inverse=True)
    return Solid(pitch * points.astype(np.float64), faces.reshape(-1, 3))
