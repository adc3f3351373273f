"""Checkers' exact distances, against numerical minimisation."""

import numpy as np
import pytest
from scipy.optimize import minimize

from benchmarks.checkers.meshes import segment_segment, segment_triangle


def minimised(first, second):
    """Least distance between two convex hulls of points, by quadratic minimisation."""

    def split(w):
        return w[: len(first)], w[len(first) :]

    def square(w):
        u, v = split(w)
        return float(((u @ first - v @ second) ** 2).sum())

    def slope(w):
        u, v = split(w)
        apart = u @ first - v @ second
        return 2 * np.concatenate([first @ apart, -(second @ apart)])

    sums = [
        {"type": "eq", "fun": lambda w: split(w)[0].sum() - 1},
        {"type": "eq", "fun": lambda w: split(w)[1].sum() - 1},
    ]
    begin = np.concatenate([np.full(len(p), 1 / len(p)) for p in (first, second)])
    options = {"ftol": 1e-14, "maxiter": 300}
    bounds = [(0, 1)] * len(begin)
    found = minimize(square, begin, jac=slope, bounds=bounds, constraints=sums, options=options)
    return np.sqrt(found.fun)


@pytest.mark.parametrize("corners", [2, 3])
def test_distance_is_the_least_between_any_two_points(corners):
    random = np.random.default_rng(corners)
    distance = segment_segment if corners == 2 else segment_triangle
    for _ in range(150):
        first = random.normal(size=(2, 3))
        second = random.normal(size=(corners, 3)) + random.normal(size=3) * random.uniform(0, 2)
        assert distance(*first, *second) == pytest.approx(minimised(first, second), abs=2e-4)


def test_crossing_parallel_touching_and_pointlike_segments():
    at = lambda *p: np.array(p, dtype=float)  # noqa: E731
    assert segment_segment(at(-1, 0, 0), at(1, 0, 0), at(0, -1, 3), at(0, 1, 3)) == 3
    assert segment_segment(at(0, 0, 0), at(1, 0, 0), at(0, 2, 0), at(1, 2, 0)) == 2
    assert segment_segment(at(0, 0, 0), at(1, 0, 0), at(4, 4, 0), at(9, 4, 0)) == 5
    assert segment_segment(at(0, 0, 0), at(1, 0, 0), at(1, 0, 0), at(2, 5, 0)) == 0
    assert segment_segment(at(1, 1, 1), at(1, 1, 1), at(0, 0, 1), at(2, 0, 1)) == 1


def test_a_segment_through_a_triangle_has_no_distance():
    corner = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0]], dtype=float)
    for flip in (corner, corner[::-1]):
        assert segment_triangle(np.array([1, 1, -1.0]), np.array([1, 1, 1.0]), *flip) == 0
        assert segment_triangle(np.array([1, 1, 2.0]), np.array([1, 1, 1.0]), *flip) == 1
        assert segment_triangle(np.array([2, 2, -1.0]), np.array([2, 2, 1.0]), *flip) > 0.7
