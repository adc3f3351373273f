"""Simulated pictures: ink where the camera must see it, the same bytes, marks that are found."""

import cv2
import numpy as np
import pytest

from gcode.deposit.lay import Laid, laid_as_is
from gcode.deposit.written import Strands
from sim.devices.camera.paint import paint
from sim.devices.camera.scene import (
    Bath,
    Camera,
    InkLook,
    Light,
    Scene,
    Sensor,
    through_surface,
)
from sim.errors import CameraError

CAMERA = Camera(
    size_px=(400, 300), um_per_px=20, target_mm=(50, 40, 1), tilt_deg=10, tilt_towards_deg=70,
    turn_deg=8, distortion=(-0.3, 0.1, 0.001, 0.001, 0),
)  # fmt: skip
SHARP = Sensor(blur_px=0, vignetting=0, full_well=1e6, read_noise=0, mono=True)
PLAIN = Scene(
    bath=Bath(texture=0, colour=(100, 100, 100)),
    ink=InkLook(colour=(200, 200, 200), edge=0, relief=0, bead="rectangle"),
    light=Light(uneven=0),
    sensor=SHARP,
)


def line(begin, end, width=0.3, height=0.1, style="embedded", layer_mm=None) -> Laid:
    start, stop = np.array([begin], float), np.array([end], float)
    area = np.array([np.pi / 4 * width**2 if style == "embedded" else width * height])
    dose = area * np.linalg.norm(stop - start, axis=1)
    none = np.zeros(1, np.int64)
    return laid_as_is(Strands(start, stop, dose, area, none, none), style, layer_mm=layer_mm)


def across(picture, pixels, way, reach=20.0):
    """Grey levels along a straight way through pixels (k, 2), (k, m), and the places, px."""
    step = np.arange(-reach, reach, 0.1)
    side = np.array([-way[1], way[0]]) / np.hypot(*way)
    at = pixels[:, None, :] + step[:, None] * side
    grey = cv2.remap(
        picture.astype(np.float32),
        at[..., 0].astype(np.float32),
        at[..., 1].astype(np.float32),
        cv2.INTER_LINEAR,
    )
    return grey, step


@pytest.mark.parametrize("surface", [None, 3.0])
def test_line_is_seen_where_the_optics_say_and_as_wide(surface):
    scene = PLAIN.model_copy(
        update={"bath": Bath(texture=0, colour=(100, 100, 100), surface_z_mm=surface)}
    )
    begin, end = np.array([47.5, 39, 1.0]), np.array([52.5, 41.2, 1.0])
    picture = paint(line(begin, end), CAMERA, scene, 1)
    places = begin + np.linspace(0.1, 0.9, 30)[:, None] * (end - begin)
    if surface is not None:
        flat = through_surface(places, CAMERA.eye_mm, surface, 1.33)
        places = np.column_stack([flat, np.full(len(flat), surface)])
    pixels = CAMERA.pixels(places)
    grey, step = across(picture, pixels, pixels[-1] - pixels[0])
    ink = grey - 100.0
    middle = (ink * step).sum(axis=1) / ink.sum(axis=1)
    assert abs(middle.mean()) < 0.06
    assert np.abs(middle).max() < 0.3
    wide = 0.1 * (ink > 0.15 * ink.max()).sum(axis=1).mean() * 0.02
    deeper = 1.0 if surface is None else 0.985
    assert wide == pytest.approx(0.3 * deeper, abs=0.02)


def test_in_air_deep_ink_is_seen_straight_below_higher_ink():
    begin, end = np.array([47.5, 39, 0.0]), np.array([52.5, 41.2, 0.0])
    lines = [line(begin, end).strands, line((48, 42.5, 3), (52, 42.5, 3)).strands]
    scene = PLAIN.model_copy(update={"bath": PLAIN.bath.model_copy(update={"turbidity_per_mm": 0})})
    picture = paint(laid_as_is(Strands.joined(lines), "embedded"), CAMERA, scene, 1)
    places = begin + np.linspace(0.2, 0.8, 20)[:, None] * (end - begin)
    pixels = CAMERA.pixels(places)
    grey, step = across(picture, pixels, pixels[-1] - pixels[0])
    ink = grey - 100.0
    middle = (ink * step).sum(axis=1) / ink.sum(axis=1)
    assert abs(middle.mean()) < 0.1


def test_missing_ink_is_missing():
    whole = line((47, 40, 1), (53, 40, 1), style="layered", layer_mm=0.1)
    halves = [line((47, 40, 1), (49.5, 40, 1)).strands, line((50.5, 40, 1), (53, 40, 1)).strands]
    picture = paint(laid_as_is(Strands.joined(halves), "layered", layer_mm=0.1), CAMERA, PLAIN, 1)
    sound = paint(whole, CAMERA, PLAIN, 1)
    gap, beside = np.round(CAMERA.pixels(np.array([[50.0, 40, 1], [48.5, 40, 1]]))).astype(int)
    assert picture[gap[1], gap[0]] == 100
    assert sound[gap[1], gap[0]] > 140
    assert picture[beside[1], beside[0]] > 140


def test_same_seed_gives_the_same_bytes_and_another_look_the_same_dish():
    scene = Scene(
        sensor=Sensor(gamma=2.2),
        seed=4,
    )
    ink = line((47, 40, 1), (53, 40, 1))
    first, again = (paint(ink, CAMERA, scene, 7) for _ in range(2))
    assert first.shape == (300, 400, 3)
    assert first.tobytes() == again.tobytes()
    other = paint(ink, CAMERA, scene, 8)
    assert 0 < np.abs(first.astype(float) - other).mean() < 5


def test_a_layer_over_another_adds_its_density_until_the_ink_is_opaque():
    levels = []
    for density in (1.0, 60.0):
        scene = PLAIN.model_copy(
            update={"ink": PLAIN.ink.model_copy(update={"density_per_mm": density})}
        )
        for heights in ((1.0,), (1.0, 1.1)):
            start = np.array([[49.0, 40.0, z] for z in heights])
            stop = start + (2.0, 0.0, 0.0)
            area = np.full(len(heights), 0.03)
            none = np.zeros(len(heights), np.int64)
            ink = laid_as_is(
                Strands(start, stop, 2 * area, area, none, none), "layered", layer_mm=0.1
            )
            picture = paint(ink, CAMERA, scene, 1)
            column, row = CAMERA.pixels(np.array([[50.0, 40.0, heights[-1]]]))[0]
            levels.append(int(picture[round(row), round(column)]))
    one, two, thick, thicker = levels
    assert two > one + 5 > 105
    assert thick == pytest.approx(thicker, abs=2)


# Projection of the simulated camera, against OpenCV's and Snell's law.

CAMERA_OPTICS = Camera(
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
    turn = cv2.Rodrigues(CAMERA_OPTICS.axes)[0]
    matrix = np.array(
        [[CAMERA_OPTICS.focal_px, 0, 599.5 + 7], [0, CAMERA_OPTICS.focal_px, 449.5 - 4], [0, 0, 1]]
    )
    wanted, _ = cv2.projectPoints(
        points,
        turn,
        -CAMERA_OPTICS.axes @ CAMERA_OPTICS.eye_mm,
        matrix,
        np.array(CAMERA_OPTICS.distortion),
    )
    np.testing.assert_allclose(CAMERA_OPTICS.pixels(points), wanted[:, 0], atol=1e-6)


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
    wide = CAMERA_OPTICS.model_copy(update={"tilt_deg": 60.0, "um_per_px": 200.0})
    with pytest.raises(CameraError, match="sees past"):
        wide.on_plane(np.array([[0.0, 0.0], [1199, 0], [1199, 899], [0, 899]]), 0.0)
