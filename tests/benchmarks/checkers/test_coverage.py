import numpy as np
import pytest

from benchmarks.checkers import box_triangles, coverage
from benchmarks.checkers.coverage import points_in
from tests.benchmarks.checkers.nets import net_of

BOX = box_triangles(np.zeros(3), np.array([4.0, 2, 2]))


def star(ends):
    """Every end hangs on the same node."""
    points = np.concatenate([[[2, 1, 3], [2, 1, 1]], ends])
    edges = [[0, 1]] + [[1, 2 + k] for k in range(len(ends))]
    return net_of(points, edges, 0.01)


def test_points_fill_the_tissue_evenly():
    points = points_in(BOX, 4000)
    assert points.mean(axis=0) == pytest.approx([2, 1, 1], abs=0.06)
    assert (points > 0).all()
    assert (points < [4, 2, 2]).all()


def test_random_terminals_reach_what_hertz_says():
    ends = np.random.default_rng(1).uniform(0, [4, 2, 2], (4000, 3))
    found = coverage(star(ends), BOX)
    assert found.mean_mm == pytest.approx(0.554 * (16 / 4000) ** (1 / 3), rel=0.05)
    assert found.near_surface == pytest.approx(1.0, abs=0.15)


def test_terminals_at_the_surface_and_far_from_it_are_told():
    ends = np.random.default_rng(1).uniform(0, [4, 2, 2], (4000, 3))
    inner = 0.5 + ends * 0.5
    assert coverage(star(inner), BOX).near_surface == 0
    assert coverage(star(inner), BOX).p95_mm > 0.4
    ends[:, 0] *= 0.02
    assert coverage(star(ends), BOX).near_surface > 2
