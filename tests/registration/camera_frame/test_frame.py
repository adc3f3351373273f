"""Camera frames by painted pictures of an insert."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.camera_frame import (
    Bath,
    PrintedPoints,
    Ties,
    Touch,
    find_marks,
    fit_frame,
    read_frame,
    write_frame,
)
from registration.errors import PictureError
from tests.registration.camera_frame import scene


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


def test_the_file_comes_back_and_a_wrong_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "frame.yaml"
    write_frame(path, scene.frame())
    assert read_frame(path) == scene.frame()
    path.write_text(path.read_text().replace("tied: touched", "tied: guessed"))
    with pytest.raises(PictureError, match=r"--frame .*: tied: .*printctl observe frame"):
        read_frame(path)


def test_a_picture_without_insert_or_of_another_size_is_refused() -> None:
    blank = np.full((800, 1000), 90, np.uint8)
    with pytest.raises(PictureError, match=r"blank.png: 0 marks of the insert are found \(4"):
        find_marks(blank, scene.insert(), scene.lens(), "blank.png")
    with pytest.raises(PictureError, match="500 x 400 px, and the camera was calibrated at 1000"):
        find_marks(blank[::2, ::2], scene.insert(), scene.lens(), "half.png")
