"""Signed distances to surfaces, against plain NumPy and analytic shapes."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface, distance_grid
from tests.registration.parts import planar_construct, planar_distance, solid
from tests.slower import examples


def naive_distance(point: FloatArray, triangle: FloatArray) -> float:
    """Distance to a triangle: inside its prism the plane's, else the nearest edge's."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal)
    sides = [np.cross(normal, q - p) @ (point - p) for p, q in ((a, b), (b, c), (c, a))]
    if min(sides) >= 0:
        return abs(float(normal @ (point - a)))
    best = np.inf
    for p, q in ((a, b), (b, c), (c, a)):
        t = np.clip((point - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
        best = min(best, float(np.linalg.norm(point - p - t * (q - p))))
    return best


@given(st.integers(0, 10_000))
@settings(max_examples=examples(25), deadline=None)
def test_distance_equals_the_smallest_over_all_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = solid(manifold3d.Manifold.hull_points(rng.uniform(-1, 1, (12, 3))))
    points = rng.uniform(-2, 2, (20, 3))
    found = ModelSurface.of(shape).query(points)
    triangles = shape.vertices[shape.faces]
    naive = [min(naive_distance(p, t) for t in triangles) for p in points]
    np.testing.assert_allclose(np.abs(found.distance), naive, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(points - found.foot, axis=1), np.abs(found.distance), atol=1e-9
    )


def test_sign_is_right_all_over_a_part_with_lumens_and_sharp_edges() -> None:
    points = np.random.default_rng(1).uniform([-1, -1, -1], [17, 9, 4], (20_000, 3))
    truth = planar_distance(points)
    clear = np.abs(truth) > 0.01  # the model's cylinders have 32 sides
    found = ModelSurface.of(planar_construct()).query(points).distance
    np.testing.assert_array_equal(found[clear] < 0, truth[clear] < 0)


def test_grid_holds_the_exact_distances_at_its_points() -> None:
    surface = ModelSurface.of(solid(manifold3d.Manifold.cube((2, 1, 1))))
    grid = distance_grid(surface, margin_mm=1.0, finest_mm=0.25)
    nz, ny, nx = grid.values.shape
    corner = grid.origin_mm + grid.step_mm * np.array([nx - 1, ny - 1, nz - 1])
    assert (corner >= surface.bounds[1] + 1.0 - 1e-9).all()
    point = grid.origin_mm + grid.step_mm * np.array([3, 5, 2])
    assert grid.values[2, 5, 3] == pytest.approx(surface.query(point[None]).distance[0], abs=1e-6)
