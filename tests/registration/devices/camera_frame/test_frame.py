"""Camera frames by painted pictures of an insert."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.checkers.dish_camera import Optics
from firmware_profiles import load
from firmware_profiles.plates import Dish
from registration.devices.camera_frame import (
    Bath,
    CameraFrame,
    PrintedPoints,
    SeenMarks,
    Ties,
    Touch,
    check_frame,
    design_insert,
    find_marks,
    fit_frame,
)
from registration.devices.camera_frame.insert import Process
from registration.errors import PictureError
from tests.registration.devices.camera_frame import scene


def places(z: float) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-14, 14, 5), np.linspace(-14, 14, 5))
    return scene.TARGET * [1, 1, 0] + np.column_stack([x.ravel(), y.ravel(), np.full(25, z)])


@pytest.mark.parametrize("z", [4.0, 1.0])
def test_pixels_become_places_within_the_stated_uncertainty(z: float) -> None:
    frame, true = scene.frame(), places(z)
    pixels = scene.optics().pixels(true)
    off = frame.to_printer(pixels, z) - true[:, :2]
    assert np.linalg.norm(off, axis=1).max() < 0.03
    spread = frame.covariance_mm2(pixels, z)
    size = np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off)
    assert size.max() < 14  # 0.1 % of two degrees of freedom
    np.testing.assert_allclose(frame.to_pixels(true), pixels, atol=0.6)
    assert frame.u_mm < 0.015
    assert frame.um_per_px == pytest.approx(79, rel=0.05)


def test_refraction_is_snells() -> None:
    frame = scene.frame().under(Bath(surface_z_mm=6.0, index=1.34))
    true = places(1.0)
    pixels = frame.to_pixels(true)
    np.testing.assert_allclose(frame.to_printer(pixels, 1.0), true[:, :2], atol=1e-9)
    # By hand: the angle in air of each ray, bent at the surface.
    straight = scene.frame()
    on_top, lower = (straight.to_printer(pixels, z) for z in (6.0, 5.0))
    slope = np.linalg.norm(lower - on_top, axis=1)
    sine = slope / np.hypot(slope, 1) / 1.34
    aside = 5.0 * sine / np.sqrt(1 - sine**2)
    np.testing.assert_allclose(np.linalg.norm(true[:, :2] - on_top, axis=1), aside, atol=1e-9)
    assert (frame.spread_mm(pixels, 1.0) > straight.spread_mm(pixels, 1.0)).all()


def test_printed_points_tie_the_frame_to_the_printer() -> None:
    corners = scene.TARGET + np.array(
        [[-10, -10, -1], [10, -10, -1], [10, 10, -1], [-10, 10, -1.0]]
    )
    points = PrintedPoints(corners, scene.optics().pixels(corners), np.full(4, 0.01))
    marks = find_marks(scene.picture(), scene.insert(), scene.lens(), "seen.png")
    ties = Ties(printed=points, z_mm=4.1, u_z_mm=0.1)
    frame = fit_frame(marks, scene.insert(), scene.lens(), ties, scene.MADE_AT)
    true = places(3.0)
    off = frame.to_printer(scene.optics().pixels(true), 3.0) - true[:, :2]
    assert np.linalg.norm(off, axis=1).max() < 0.03
    assert frame.tied == "printed"


def test_touches_that_dont_fit_are_refused() -> None:
    marks = find_marks(scene.picture(), scene.insert(), scene.lens(), "seen.png")

    def fit(*touches: Touch) -> None:
        fit_frame(marks, scene.insert(), scene.lens(), Ties(touches=touches), scene.MADE_AT)

    with pytest.raises(PictureError, match="one touched cross doesn't say"):
        fit(Touch("left", 80, 90))
    with pytest.raises(PictureError, match="no cross 'west'; it has left, right, front, back"):
        fit(Touch("west", 80, 90), Touch("left", 80, 90))
    with pytest.raises(PictureError, match="the touched crosses don't fit the insert"):
        fit(Touch("left", 70, 90), Touch("right", 110, 90))


def bent_plate(plane: np.ndarray, bent_mm: float, taller: float) -> np.ndarray:
    """Places (n, 3) of drawn ones on a plate bent along x and stretched along y."""
    flat = plane * [1.0, 1 + taller]
    up = bent_mm * ((2 * plane[:, 0] / scene.insert().plate_mm[0]) ** 2 - 0.5)
    return scene.TARGET + np.column_stack([flat, up])


def fitted_to_plate(
    bent_mm: float, taller: float, process: Process, focus: float = 1.0, touched: bool = True
) -> tuple[CameraFrame, Optics]:
    """Frame of marks and exact touches on such a plate, and the camera that saw it."""
    insert = design_insert(load(Dish, "petri_35mm"), process=process, mark_mm=7.0)
    camera = replace(scene.optics(), focal=scene.optics().focal * focus)
    rng = np.random.default_rng(1)
    corners = bent_plate(insert.corners().reshape(-1, 2), bent_mm, taller)
    pixels = (camera.pixels(corners) + rng.normal(0, 0.03, (len(corners), 2))).reshape(-1, 4, 2)
    marks = SeenMarks(np.arange(len(pixels)), pixels, np.full(len(pixels), 0.03), 0.8, 0.1, 0.8)
    middles = np.array([[c.x_mm, c.y_mm] for c in insert.crosses])
    touches = [
        Touch(cross.name, *map(float, place), u_mm=0.01)
        for cross, place in zip(insert.crosses, bent_plate(middles, bent_mm, taller), strict=True)
    ]
    ties = Ties(touches=touches if touched else ())
    return fit_frame(marks, insert, scene.lens(), ties, scene.MADE_AT), camera


@pytest.mark.parametrize(("bent_mm", "taller"), [(0.2, 0.0), (0.0, 2e-3), (-0.15, -2e-3)])
def test_a_bent_or_stretched_plate_is_fitted(bent_mm: float, taller: float) -> None:
    frame, camera = fitted_to_plate(bent_mm, taller, "paper")
    true = places(4.0)
    pixels = camera.pixels(true)
    off = frame.to_printer(pixels, 4.0) - true[:, :2]
    assert np.linalg.norm(off, axis=1).max() < 0.02
    spread = frame.covariance_mm2(pixels, 4.0)
    assert np.einsum("ni,nij,nj->n", off, np.linalg.inv(spread), off).max() < 14


def test_touches_that_scatter_more_than_stated_are_refused_or_believed_less() -> None:
    marks = find_marks(scene.picture(), scene.insert(), scene.lens(), "seen.png")
    crosses = scene.insert().crosses
    there = scene.made().world(np.array([[c.x_mm, c.y_mm] for c in crosses]))
    signs = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, -1], [1, 1, -1.0]])

    def u_mm(off_mm: float) -> float:
        touches = [
            Touch(c.name, *map(float, place), u_mm=0.01)
            for c, place in zip(crosses, there + off_mm * signs, strict=True)
        ]
        ties = Ties(touches=touches)
        return fit_frame(marks, scene.insert(), scene.lens(), ties, scene.MADE_AT).u_mm

    assert u_mm(0.018) > 1.2 * u_mm(0.002)
    with pytest.raises(PictureError, match=r"they scatter .* times as much as touches good to 10"):
        u_mm(0.035)


# Checks of a frame by another picture.

HIDDEN = replace(scene.SCENE, hidden=[(-0.45, -0.35, 0.35)])


def test_an_unmoved_camera_passes_with_marks_hidden() -> None:
    answer = check_frame(scene.shifted(0, 0, HIDDEN), scene.frame())
    assert answer.holds, answer.why
    assert answer.moved_um < 10
    assert answer.marks < len(scene.insert().marks)


def test_a_bump_of_100_um_is_noticed_with_marks_hidden() -> None:
    answer = check_frame(scene.shifted(0.07, -0.07, HIDDEN), scene.frame())
    assert not answer.holds
    assert abs(answer.moved_um - 100) < 10
    assert "camera or insert moved" in answer.why[0]


def test_marks_on_one_side_alone_dont_pass_for_a_whole_dish() -> None:
    seen = scene.frame().seen
    v = seen.corners[:, :, 1].mean(axis=1)
    u = seen.corners[:, :, 0].mean(axis=1)
    # Black out all but the marks along one side of the insert.
    middles = {mark.number: (mark.x_mm, mark.y_mm) for mark in scene.insert().marks}
    top = max(y for _, y in middles.values())
    image = scene.picture().copy()
    for n, number in enumerate(seen.numbers):
        if middles[number][1] < top - 1:
            image[int(v[n]) - 40 : int(v[n]) + 40, int(u[n]) - 40 : int(u[n]) + 40] = 90
    answer = check_frame(image, scene.frame())
    assert not answer.holds
    assert "don't tell" in answer.why[0] or "wanted" in answer.why[0]
