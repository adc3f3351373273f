"""Remeshing: preserves shape and genus, produces the wanted triangles."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import SolidError
from design.solids.remesh import LabelledSurface, patches, remesh
from tests.design.solids.remesh.shapes import (
    Cube,
    Sphere,
    Torus,
    areas,
    cube_surface,
    edges,
    euler,
    qualities,
    torus_surface,
    volume,
)


def _ball() -> LabelledSurface:
    rough = cube_surface()
    points = rough.vertices / np.sqrt(3.0)
    return LabelledSurface(points, rough.faces, np.zeros(12, np.int64))


def test_a_cube_becomes_an_even_sphere() -> None:
    found = remesh(_ball(), Sphere(0.2))
    assert euler(found) == 2
    assert qualities(found).min() > 0.6
    assert qualities(found).mean() > 0.95
    assert np.linalg.norm(found.vertices, axis=1) == pytest.approx(np.ones(len(found.vertices)))
    # Flat triangles of edge h on a unit sphere lack h²/8·(…) of its area and volume.
    assert areas(found).sum() == pytest.approx(4.0 * np.pi, rel=0.01)
    assert volume(found) == pytest.approx(4.0 * np.pi / 3.0, rel=0.02)
    assert 0.8 * 0.2 < edges(found).mean() < 1.2 * 0.2
    assert edges(found).max() < 1.6 * 0.2
    assert edges(found).min() > 0.5 * 0.2


def test_a_fine_surface_is_made_coarse() -> None:
    fine = remesh(_ball(), Sphere(0.1))
    coarse = remesh(fine, Sphere(0.4))
    assert len(coarse.faces) < len(fine.faces) / 8
    assert euler(coarse) == 2
    assert qualities(coarse).min() > 0.5


def test_edges_grow_where_longer_ones_are_wanted() -> None:
    found = remesh(_ball(), Sphere(0.16, slope=0.5), growth=1.0)
    middle = found.vertices[found.faces].mean(axis=1)
    mean = edges(found).mean(axis=1)
    low, high = mean[middle[:, 2] < -0.8].mean(), mean[middle[:, 2] > 0.8].mean()
    assert low == pytest.approx(0.16 * 0.55, rel=0.25)
    assert high == pytest.approx(0.16 * 1.45, rel=0.25)
    slow = remesh(_ball(), Sphere(0.16, slope=0.5), growth=0.02)
    even = edges(slow).mean(axis=1)
    # Edges may grow by 2 % of the way, which is a half turn at most: 0.07 + 0.02·π.
    assert even.max() < 1.5 * (0.08 + 0.02 * np.pi)


def test_a_torus_stays_a_torus() -> None:
    wide, thin = 1.0, 0.3
    found = remesh(torus_surface(wide, thin), Torus(wide, thin, 0.1))
    assert euler(found) == 0
    assert qualities(found).min() > 0.5
    assert areas(found).sum() == pytest.approx(4.0 * np.pi**2 * wide * thin, rel=0.02)
    assert volume(found) == pytest.approx(2.0 * np.pi**2 * wide * thin**2, rel=0.04)


def test_rims_and_corners_stay_where_they_are() -> None:
    found = remesh(cube_surface(), Cube(0.3))
    assert euler(found) == 2
    assert volume(found) == pytest.approx(8.0, rel=1e-12)
    assert areas(found) @ (found.label == 3) == pytest.approx(4.0, rel=1e-12)
    for label in range(6):
        side = found.vertices[np.unique(found.faces[found.label == label])]
        assert side[:, label // 2] == pytest.approx(np.full(len(side), 2.0 * (label % 2) - 1.0))
    at_corner = (np.abs(np.abs(found.vertices) - 1.0) < 1e-12).all(axis=1)
    assert at_corner.sum() == 8
    assert qualities(found).min() > 0.4
    assert edges(found).max() < 1.7 * 0.3


def test_patches_tell_sides_from_rims() -> None:
    rough = cube_surface()
    assert (patches(rough) < 0).all()
    fine = remesh(rough, Cube(0.5))
    patch = patches(fine)
    for vertex, label in enumerate(patch):
        mine = set(fine.label[(fine.faces == vertex).any(axis=1)].tolist())
        assert (label >= 0 and mine == {label}) or (len(mine) > 1 and -1 - max(mine) == label)


def test_the_same_surface_comes_out_of_the_same_input() -> None:
    first, second = (remesh(torus_surface(1.0, 0.3), Torus(1.0, 0.3, 0.15)) for _ in range(2))
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.faces, second.faces)


def test_open_and_turned_surfaces_and_sizes_of_nothing_are_refused() -> None:
    rough = _ball()
    open_one = LabelledSurface(rough.vertices, rough.faces[1:], rough.label[1:])
    turned = LabelledSurface(
        rough.vertices, np.concatenate([rough.faces[:1, ::-1], rough.faces[1:]]), rough.label
    )
    doubled = LabelledSurface(
        rough.vertices, np.concatenate([rough.faces, rough.faces]), np.zeros(24, np.int64)
    )
    for bad in (open_one, turned, doubled):
        with pytest.raises(SolidError, match="isn't closed"):
            remesh(bad, Sphere(0.3))
    with pytest.raises(SolidError, match="wanted edge length"):
        remesh(rough, Sphere(float("nan")))
