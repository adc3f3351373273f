"""The distances of many points from a triangle are those of each alone."""

from __future__ import annotations

import numpy as np
import pytest

from design.geometry import point_triangle_squared
from design.tissue.build import _ROOM, _nearer

RNG = np.random.default_rng(7)
FLAT = np.array([0.0, 0, 0, 1, 0, 0, 0.4, 0.9, 0])


def squeezed(height: float) -> np.ndarray:
    """A triangle of that height over its longest edge."""
    return np.array([0.0, 0, 0, 1, 0, 0, 0.5, height, 0])


@pytest.mark.parametrize(
    "triangle",
    [
        FLAT,
        *(RNG.normal(size=9) for _ in range(40)),
        *(squeezed(10.0**-k) for k in range(2, 16, 2)),
        np.array([0.0, 0, 0, 1, 0, 0, 2, 0, 0]),  # in a line
        np.array([0.0, 0, 0, 1, 0, 0, 1, 0, 0]),  # an edge twice
        np.zeros(9),
    ],
)
def test_many_points_at_once_lie_as_far_as_each_alone(triangle: np.ndarray) -> None:
    where = RNG.normal(size=(3, _ROOM))
    where[:, :3] = triangle.reshape(3, 3).T  # on its corners
    where[:, 3] = triangle.reshape(3, 3).mean(axis=0)
    best = np.full(_ROOM, np.inf)
    _nearer(triangle, where, best)
    each = [point_triangle_squared(*point, triangle) for point in where.T]
    np.testing.assert_allclose(np.sqrt(best), np.sqrt(each), rtol=1e-9, atol=1e-9)


def test_what_is_farther_changes_nothing() -> None:
    where, best = RNG.normal(size=(3, _ROOM)) + 5, np.full(_ROOM, 0.01)
    _nearer(FLAT, where, best)
    assert (best == 0.01).all()
