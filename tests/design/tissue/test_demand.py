from dataclasses import replace

import numpy as np
import pytest

from design.errors import TissueError
from design.tissue import (
    VolumeImage,
    block,
    depth_demand,
    function_demand,
    image_demand,
)
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue


@pytest.fixture(scope="module")
def cube():
    shape = block((10.0, 10.0, 10.0))
    return kept_tissue(shape)


@pytest.fixture(scope="module")
def ball():
    shape = surfaces.surface(surfaces.sphere(10.0, 128))
    return kept_tissue(shape)


def inside(tissue, count, seed=0):
    low, high = tissue.bounds
    points = np.random.default_rng(seed).uniform(low, high, (count, 3))
    return points[tissue.contains(points)]


def test_table_by_depth_is_linear_and_flat_beyond(ball):
    demand = depth_demand(ball, [1.0, 3.0], [4.0, 2.0])
    points = np.array([[9.5, 0, 0], [8.0, 0, 0], [7.5, 0, 0], [2.0, 0, 0]])
    np.testing.assert_allclose(demand.weight(points), [1.0, 0.75, 0.625, 0.5], atol=0.01)


def test_mean_weight_is_the_volume_mean(ball):
    # Depth d is at radius 10 - d: the mean of d / 10 is a quarter.
    assert depth_demand(ball, [0.0, 10.0], [0.0, 5.0]).mean_weight == pytest.approx(0.25, rel=0.01)
    # Only the outer 2 mm: 1 - 0.8^3.
    shell = depth_demand(ball, [2.0, 2.0001], [1.0, 0.0])
    assert shell.mean_weight == pytest.approx(1 - 0.8**3, rel=0.01)


def test_bound_is_found_where_none_is_given(cube):
    demand = function_demand(cube, lambda p: 3.0 * p[:, 0])
    assert 30.0 < demand.greatest < 33.1
    ratio = demand.weight(np.array([[2.0, 5, 5]])) / demand.mean_weight
    assert ratio == pytest.approx(0.4, rel=1e-3)


def test_function_above_its_bound_is_an_error_not_a_bias(cube):
    with pytest.raises(TissueError, match=r"above the greatest value 20"):
        function_demand(cube, lambda p: 3.0 * p[:, 0], greatest=20.0)


def test_image_is_linear_between_voxels(cube):
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    affine[:3, 3] = 1.0
    values = np.broadcast_to(np.arange(5)[:, None, None], (5, 5, 5)).astype(np.int16)
    demand = image_demand(cube, VolumeImage(values, affine))
    points = np.array([[1.0, 5, 5], [4.0, 5, 5], [9.0, 5, 5], [10.0, 5, 5]])
    np.testing.assert_allclose(demand.weight(points), [0.0, 0.375, 1.0, 1.0], atol=1e-12)
    assert demand.mean_weight == pytest.approx(0.5, rel=1e-3)


def test_accepting_by_weight_places_points_by_demand_and_keeps_the_total(ball):
    tissue = replace(ball, demand=depth_demand(ball, [0.0, 10.0], [1.0, 0.0]))
    points = inside(tissue, 60_000, seed=1)
    weight = tissue.demand.weight(points)
    kept = points[np.random.default_rng(2).uniform(size=len(points)) < weight]
    assert len(kept) / len(points) == pytest.approx(tissue.demand.mean_weight, abs=0.01)
    radius = np.linalg.norm(kept, axis=1)
    # Density r/10 over the sphere: the share within radius r is (r/10)^4.
    for r in (4.0, 6.0, 8.0):
        assert (radius < r).mean() == pytest.approx((r / 10) ** 4, abs=0.015)
    assert (weight / tissue.demand.mean_weight).mean() == pytest.approx(1.0, abs=0.01)


def image(values, scale=5.0):
    return VolumeImage(values, np.diag([scale, scale, scale, 1.0]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda t: depth_demand(t, [0, 1], [1]), "2 depths and 1 relative"),
        (lambda t: depth_demand(t, [1, 0], [1, 1]), "don't ascend"),
        (lambda t: depth_demand(t, [0], [-1]), "negative"),
        (lambda t: depth_demand(t, [0], [0]), "0 at every depth"),
        (lambda t: depth_demand(t, [50, 51], [0, 1]), "0 throughout the tissue"),
        (lambda t: function_demand(t, lambda p: p[:, 0] * np.nan), "NaN"),
        (lambda t: function_demand(t, lambda p: p), "gave shape"),
        (lambda t: function_demand(t, lambda p: 0 * p[:, 0]), "ask for something"),
        (lambda t: image_demand(t, image(np.ones((3, 3, 3)), 1.0)), r"covers \d+ % of the tissue"),
        (lambda t: image_demand(t, image(np.zeros((3, 3, 3)))), "0 everywhere"),
        (lambda t: image_demand(t, image(-np.ones((3, 3, 3)))), "negative"),
    ],
)
def test_impossible_demand_is_refused(cube, make, message):
    with pytest.raises(TissueError, match=message):
        make(cube)
