"""Curvature of meshes, and the shift of a curved surface by blur."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from registration.alignment.distance import ModelSurface
from registration.segmentation.nets import surface
from tests.registration.parts import ball, rod, solid


def area_mean(model: ModelSurface, where: np.ndarray) -> float:
    a, b, c = (model.triangles[where, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(np.average(model.curvature[where], weights=area))


def test_a_ball_bends_both_ways_and_a_rod_one_way() -> None:
    sphere = ModelSurface.of(solid(ball(np.zeros(3), 2.0)))
    assert area_mean(sphere, np.ones(len(sphere.curvature), bool)) == pytest.approx(1.0, rel=0.02)
    bar = ModelSurface.of(solid(rod(np.zeros(3), np.array([10.0, 0, 0]), 0.5)))
    side = np.ptp(bar.triangles[:, :, 0], axis=1) > 1
    assert area_mean(bar, side) == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize("radius", [0.2, 0.4])
def test_a_blurred_lumen_is_narrower_by_what_its_curvature_says(radius: float) -> None:
    voxel, sigma, n = 0.02, 0.04, 61
    _, y, x = (np.indices((9, n, n)) - (n - 1) / 2) * voxel
    gel = np.clip(0.5 + (np.hypot(x, y) - radius) / voxel, 0, 1)
    blurred = gaussian_filter(gel, sigma / voxel).astype(np.float32)
    found, _, _ = surface(blurred, 0.5, 1.0)
    away = np.hypot(*((found[:, :2] - (n - 1) / 2) * voxel).T)
    middle = np.array([0.0, 0.0, 0.0])
    block = manifold3d.Manifold.cube((4.0, 4.0, 4.0), True)
    bored = block - rod(middle - [0, 0, 3], middle + [0, 0, 3], radius, 128)
    model = ModelSurface.of(solid(bored))
    face = model.query(np.array([[radius, 0.0, 0.0]])).face
    # Distance is positive outside the gel: towards the axis.
    shift = float(model.blurred(face, sigma)[0])
    assert shift == pytest.approx(sigma**2 / (2 * radius), rel=0.05)
    assert radius - away.mean() == pytest.approx(shift, abs=8e-4)
