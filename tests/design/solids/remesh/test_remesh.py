"""Remeshing: preserves shape and genus, produces the wanted triangles."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import SolidError
from design.solids.remesh import LabelledSurface, remesh
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
