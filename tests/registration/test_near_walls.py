"""Surface points near vessel walls, against brute-force distances."""

from __future__ import annotations

import numpy as np

from registration.measuring.gauging.vessels import near_walls


def test_walls_are_those_of_the_lumens_that_points_are_deepest_in():
    rng = np.random.default_rng(3)
    centre, radius = rng.uniform(0, 5, (60, 3)), rng.choice([0.1, 0.2, 0.32, 0.5], 60)
    points = rng.uniform(-2, 7, (4000, 3))
    outside = np.linalg.norm(points[:, None] - centre, axis=2) - radius
    nearest = outside.argmin(axis=1)
    expected = np.abs(outside.min(axis=1)) < np.maximum(0.5 * radius[nearest], 0.1)
    which, wall = near_walls(centre, radius, points)
    assert 0 < expected.sum() < len(points)
    np.testing.assert_array_equal(wall, expected)
    np.testing.assert_array_equal(which[wall], nearest[wall])


def test_the_wall_of_a_wide_lumen_isnt_that_of_a_thin_one_that_leaves_it():
    """A wide lumen's rounded end, 0.25 mm beside the axis of a thin vessel that begins there."""
    thin = np.column_stack([np.arange(0.05, 3, 0.1), np.zeros(30), np.zeros(30)])
    wide = np.column_stack([np.zeros(20), np.arange(0.05, 2, 0.1), np.zeros(20)])
    centre = np.concatenate([thin, wide])
    radius = np.repeat([0.2, 0.5], [30, 20])
    which, wall = near_walls(centre, radius, np.array([[0.35, -0.18, 0.19], [1.0, 0.0, 0.21]]))
    assert wall.all()
    assert which.tolist() == [30, 9]
