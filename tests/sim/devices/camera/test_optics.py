"""Projection of the simulated camera, against OpenCV's and Snell's law."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from sim.devices.camera.optics import Camera, through_surface
from sim.errors import CameraError

CAMERA = Camera(
    size_px=(1200, 900),
    um_per_px=20,
    target_mm=(100, 80, 2),
    distance_mm=120,
    tilt_deg=17,
    tilt_towards_deg=35,
    turn_deg=12,
    centre_off_px=(7, -4),
    distortion=(-0.2, 0.08, 0.001, -0.0015, 0.01),
)


def test_pixels_are_those_of_opencv():
    generator = np.random.default_rng(1)
    points = np.array([100, 80, 2]) + generator.uniform(-8, 8, (50, 3))
    turn = cv2.Rodrigues(CAMERA.axes)[0]
    matrix = np.array([[CAMERA.focal_px, 0, 599.5 + 7], [0, CAMERA.focal_px, 449.5 - 4], [0, 0, 1]])
    wanted, _ = cv2.projectPoints(
        points, turn, -CAMERA.axes @ CAMERA.eye_mm, matrix, np.array(CAMERA.distortion)
    )
    np.testing.assert_allclose(CAMERA.pixels(points), wanted[:, 0], atol=1e-6)


def test_rays_break_by_snell():
    generator = np.random.default_rng(3)
    eye = np.array([1.0, 2.0, 60.0])
    points = np.column_stack([generator.uniform(-20, 20, (40, 2)), generator.uniform(-8, -1, 40)])
    at = np.column_stack([through_surface(points, eye, 0.0, 1.37), np.zeros(40)])
    into, below = at - eye, points - at
    sine = np.linalg.norm(into[:, :2], axis=1) / np.linalg.norm(into, axis=1)
    refracted = np.linalg.norm(below[:, :2], axis=1) / np.linalg.norm(below, axis=1)
    np.testing.assert_allclose(sine, 1.37 * refracted, rtol=1e-9)
    np.testing.assert_allclose(into[:, 0] * below[:, 1], into[:, 1] * below[:, 0], atol=1e-9)


def test_looking_past_the_dish_is_refused():
    wide = CAMERA.model_copy(update={"tilt_deg": 60.0, "um_per_px": 200.0})
    with pytest.raises(CameraError, match="sees past"):
        wide.on_plane(np.array([[0.0, 0.0], [1199, 0], [1199, 899], [0, 899]]), 0.0)
