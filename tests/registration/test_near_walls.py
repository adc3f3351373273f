"""Points near vessels' walls, against all distances."""

from __future__ import annotations

import numpy as np

from registration.gauging.near_walls import near_walls


def test_walls_are_those_of_all_distances():
    rng = np.random.default_rng(3)
    centre, radius = rng.uniform(0, 5, (60, 3)), rng.uniform(0.1, 0.5, 60)
    points = rng.uniform(-2, 7, (4000, 3))
    away = np.linalg.norm(points[:, None] - centre, axis=2)
    nearest = away.argmin(axis=1)
    off = np.abs(away.min(axis=1) - radius[nearest])
    expected = off < np.maximum(0.5 * radius[nearest], 0.1)
    which, wall = near_walls(centre, radius, points)
    assert 0 < expected.sum() < len(points)
    np.testing.assert_array_equal(wall, expected)
    np.testing.assert_array_equal(which[wall], nearest[wall])
