"""The needle's tip in painted pictures."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.checkers.dish_camera import (
    Needle,
    Optics,
    Scene,
    aimed,
    developed,
    rough_ground,
    with_needle,
)
from registration.devices.camera_frame import CameraFrame, TipView, find_tip, grounds, locate_tip
from registration.devices.camera_frame.frame import turn_vector
from registration.errors import PictureError
from tests.registration.devices.camera_frame import scene

MIDDLE = np.array([100.0, 90.0, 12.0])
OFFSET = np.array([0.35, -0.2, 0.4])
OUTER = 0.51
PLACES = MIDDLE + np.array([[-6, -4, 0], [6, 4, 0], [-4, 6, 0], [4, -6, 0.0]])
UP = np.array([0.004, -0.003, 1.0]) / np.linalg.norm([0.004, -0.003, 1.0])


@cache
def optics(azimuth: float = 0.8) -> Optics:
    rotation, centre = aimed(MIDDLE, 90.0, np.radians(50), azimuth, 2.0)
    return Optics((800, 700), 2700.0, (400.0, 350.0), (-0.1, 0.03), (4e-4, -3e-4),
                  rotation, centre)  # fmt: skip


@cache
def frame(azimuth: float = 0.8) -> CameraFrame:
    """The checker's own camera, known well."""
    camera = optics(azimuth)
    lens = scene.lens().model_copy(
        update={
            "size_px": camera.size,
            "focal_px": camera.focal,
            "centre_px": camera.axis,
            "distortion": (*camera.k, *camera.p, 0.0),
        }
    )
    spread = np.diag([1e-7] * 3 + [3e-3] * 3 + [1e-9] * 8) ** 2
    return scene.frame().model_copy(
        update={
            "lens": lens,
            "turn_vector": tuple(turn_vector(camera.rotation)),
            "eye_mm": tuple(camera.centre),
            "covariance": tuple(tuple(row) for row in spread.tolist()),
        }
    )


@cache
def pictures(azimuth: float, slope: float, count: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(5)
    camera = optics(azimuth)
    ground = rough_ground(camera.size, rng, 160.0, 10.0)
    return tuple(
        developed(
            with_needle(camera, ground, Needle(at + OFFSET, OUTER, UP, slope=slope)),
            Scene(blur=0.9, quality=90), rng,
        )
        for at in PLACES[:count]
    )  # fmt: skip


@cache
def seen(azimuth: float = 0.8, slope: float = 0.0, count: int = 4) -> list[TipView]:
    images, eye = pictures(azimuth, slope, count), frame(azimuth)
    behind = grounds(images, eye, PLACES[:count], OUTER, 1.0)
    return [
        TipView(eye, find_tip(image, eye, at, OUTER, reach_mm=1.0, ground=back), at)
        for image, at, back in zip(images, PLACES[:count], behind, strict=True)
    ]


def test_two_cameras_find_the_tip_to_20_um() -> None:
    tip = locate_tip([*seen()[:2], *seen(azimuth=2.6, count=2)], OUTER)
    assert np.linalg.norm(tip.offset_mm - OFFSET) < 0.02
    assert tip.u_mm.max() < 0.02


@pytest.mark.parametrize(("bright", "dark", "level"), [(235.0, 120.0, 60.0), (35.0, 20.0, 110.0)])
def test_an_end_is_found_to_a_part_of_a_pixel_though_light_falls_off_along_the_needle(
    bright: float, dark: float, level: float
) -> None:
    camera, eye, at = optics(), frame(), PLACES[0]
    rng = np.random.default_rng(11)
    ground = rough_ground(camera.size, rng, level, 6.0)
    needle = Needle(at + OFFSET, OUTER, UP, bright=bright, dark=dark, thread=0.1, light=0.2)
    true = camera.pixels((at + OFFSET)[None])[0]
    away = camera.pixels((at + OFFSET + [0, 0, 0.2])[None])[0] - true
    up = away / np.linalg.norm(away)
    # A tenth brighter or darker for each width up the needle, as beside a lamp or over a bath.
    rows, columns = np.indices(ground.shape)
    along = (columns - true[0]) * up[0] + (rows - true[1]) * up[1]
    painted = with_needle(camera, ground, needle)
    rod = np.abs(painted - ground) > 0
    painted[rod] *= np.clip(1 - 0.1 * along[rod] / (OUTER * 30.0), 0.4, 1.2)
    image, back = (developed(one, Scene(blur=0.9, quality=92), rng) for one in (painted, ground))
    seen = find_tip(image, eye, at, OUTER, reach_mm=1.0, ground=back)
    off = seen.pixel - true
    assert abs(off @ up) < 0.15
    assert abs(off @ np.array([-up[1], up[0]])) < 0.1
    assert np.sqrt(np.linalg.eigvalsh(seen.covariance_px2)).max() < 0.2


@pytest.mark.slow
def test_one_camera_and_four_places_find_it_within_the_stated_uncertainty() -> None:
    tip = locate_tip(seen(), OUTER)
    off = tip.offset_mm - OFFSET
    assert (np.abs(off) < 2.5 * tip.u_mm).all()
    assert tip.u_mm.max() < 0.06
    assert tip.outer_mm == pytest.approx(OUTER, rel=0.05)
    assert not tip.worn


def test_no_needle_is_not_found() -> None:
    rng = np.random.default_rng(6)
    bare = developed(rough_ground(optics().size, rng, 160.0, 10.0), Scene(), rng)
    with pytest.raises(PictureError, match="needle"):
        find_tip(bare, frame(), PLACES[0], OUTER, reach_mm=1.0)
    with pytest.raises(PictureError, match="the camera looks along the needle"):
        find_tip(bare, frame(), optics().centre * [1, 1, 0] + [0.1, 0, 12], OUTER)


def test_a_wrong_place_of_one_picture_is_refused() -> None:
    views = seen()
    wrong = [*views[:3], TipView(frame(), views[3].seen, PLACES[3] + [1.0, 0, 0])]
    with pytest.raises(PictureError, match="picture 4 doesn't fit the others"):
        locate_tip(wrong, OUTER)
