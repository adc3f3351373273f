"""Surface deviation in both directions, on known shapes."""

from __future__ import annotations

from dataclasses import asdict

import manifold3d
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from design.geometry.surface import Surface
from design.solids.solid import Solid
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging import (
    ScannedSurface,
    deviations,
    hausdorff_p95_um,
    summarise,
    surface_points,
)
from registration.measuring.gauging.face_places import FacePlace, ScannedFaces
from registration.report.sections import place_rows
from registration.segmentation import GelField, Segmentation
from registration.segmentation.mesh import surface_mesh
from tests.registration.parts import planar_construct, solid

HERE = Fit(np.eye(3), np.zeros(3), np.ones(3), np.zeros(3))
VOXEL = 0.04


def ball_scan(radius: float, middle: tuple[float, float, float] = (0, 0, 0)) -> Segmentation:
    """A ball of gel in liquid, as segmented."""
    axis = np.arange(-1.6, 1.6, VOXEL)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    away = np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
    values = np.clip(0.5 + (radius - away) / 0.3, 0, 1).astype(np.float32)
    field = GelField(values, 0.5, 1.0, np.full(3, VOXEL), np.full(3, -1.6), 0.0)
    surface, outward, seen = surface_mesh(field, None, 0.1)
    return Segmentation(field, surface, outward, seen, 9.0, None)


def deviations_back(points: np.ndarray, scan: Segmentation, fit: Fit) -> np.ndarray:
    return ScannedSurface.of(scan).deviations_back(points, fit)


def ball_model(radius: float) -> ModelSurface:
    return ModelSurface.of(solid(manifold3d.Manifold.sphere(radius, 128)))


@pytest.mark.parametrize("excess", [-0.06, 0.0, 0.08])
def test_larger_ball_deviates_negatively_by_its_excess_both_ways(excess: float) -> None:
    model, scan = ball_model(1.0), ball_scan(1.0 + excess)
    there = deviations(model, scan.surface.vertices, False)
    back = deviations_back(surface_points(model, 5000), scan, HERE)
    np.testing.assert_allclose(there, -excess, atol=0.004)
    np.testing.assert_allclose(back, -excess, atol=0.004)
    assert hausdorff_p95_um(there, back) == pytest.approx(1e3 * abs(excess), abs=4)


def test_eccentric_ball_deviates_by_the_cosine() -> None:
    model, scan = ball_model(1.0), ball_scan(1.0, (0.1, 0, 0))
    points = surface_points(model, 4000)
    back = deviations_back(points, scan, HERE)
    expected = np.linalg.norm(points - [0.1, 0, 0], axis=1) - 1
    np.testing.assert_allclose(back, expected, atol=0.004)
    found = summarise(back)
    assert found.mean_um == pytest.approx(0, abs=5)
    # Over a ball x is uniform in [-1, 1].
    assert found.rms_um == pytest.approx(100 / np.sqrt(3), rel=0.05)
    assert found.max_um == pytest.approx(100, abs=5)


def test_what_isnt_in_the_field_of_view_isnt_measured_back() -> None:
    scan = ball_scan(1.0)
    half = scan.field.values[:, :, : int(1.6 / VOXEL)]
    field = GelField(half, 0.5, 1.0, np.full(3, VOXEL), np.full(3, -1.6), 0.0)
    part = Segmentation(field, scan.surface, scan.outward, scan.seen, 9.0, None)
    points = surface_points(ball_model(1.0), 4000)
    assert len(deviations_back(points, part, HERE)) == pytest.approx(2000, rel=0.08)


def test_way_back_is_exact_in_any_frame() -> None:
    scan = ball_scan(1.0)
    turn = Rotation.from_euler("xyz", (4, -3, 8), degrees=True).as_matrix()
    fit = Fit(turn, np.array([0.05, -0.02, 0.01]), np.array([1.02, 0.98, 1.01]), np.zeros(3))
    points = surface_points(ball_model(1.0), 2000)
    surface = ModelSurface.of(Solid(fit.apply(scan.surface.vertices), scan.surface.faces))
    found = deviations_back(points, scan, fit)
    # The facets' side, and the field's, of the few points that lie on the surface may differ.
    np.testing.assert_allclose(np.abs(found), np.abs(surface.query(points).distance), atol=1e-12)
    assert (np.sign(found) == np.sign(surface.query(points).distance)).mean() > 0.99


# Chips and bumps on a scanned face are listed where they are; noise and rounded rims aren't.

SIDE, STEP = 200, 0.025


def face() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A face of 5 × 5 mm with speckle of 12 µm, correlated over 60 µm: vertices, triangles, µm."""
    x, y = np.meshgrid(STEP * np.arange(SIDE), STEP * np.arange(SIDE), indexing="ij")
    corner = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    triangles = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    noise = gaussian_filter(np.random.default_rng(5).normal(size=x.shape), 2.4, mode="wrap")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate(triangles).astype(np.int32), 12 * noise.ravel() / noise.std()


def listed(off: np.ndarray, rims: np.ndarray | None = None) -> tuple[FacePlace, ...]:
    vertices, triangles, _ = face()
    none = np.zeros(len(off), dtype=bool)
    known = off[np.isfinite(off)]
    spread = 1.4826 * np.median(np.abs(known - np.median(known))) if len(known) else 0.0
    rims = none if rims is None else rims
    return ScannedFaces(Surface(vertices, triangles), off, rims, 50, float(spread)).places_off()


def away(x: float, y: float) -> np.ndarray:
    vertices = face()[0]
    return np.hypot(vertices[:, 0] - x, vertices[:, 1] - y)


def test_a_pit_and_a_bump_are_listed_with_sign_size_and_place() -> None:
    off = face()[2] + 300 * (away(3.0, 1.5) < 0.4) - 200 * (away(1.0, 4.0) < 0.3)
    pit, bump = listed(off)
    assert pit.deviation_um == pytest.approx(300, abs=30)
    assert bump.deviation_um == pytest.approx(-200, abs=30)
    assert pit.area_mm2 == pytest.approx(np.pi * 0.4**2, rel=0.1)
    np.testing.assert_allclose(pit.at_mm, [3.0, 1.5, 0], atol=0.4)
    np.testing.assert_allclose(bump.at_mm, [1.0, 4.0, 0], atol=0.3)
    rows = place_rows({"by_surface": {"outer_faces": {"places": [asdict(pit), asdict(bump)]}}})
    assert [float(row[1]) for row in rows] == pytest.approx([0.5, 0.28], abs=0.05)


def test_direction_is_the_gradient_of_the_distance() -> None:
    surface = ModelSurface.of(planar_construct())
    points = np.random.default_rng(2).uniform([0, 0, 0], [16, 8, 3], (300, 3))
    here = surface.query(points)
    ahead = surface.query(points + 1e-5 * here.direction).distance
    back = surface.query(points - 1e-5 * here.direction).distance
    np.testing.assert_allclose((ahead - back) / 2e-5, 1.0, atol=0.02)
