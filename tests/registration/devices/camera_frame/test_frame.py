"""Camera frames by painted pictures of an insert; dish inserts; the needle's tip."""

from dataclasses import replace
from functools import cache

import cv2
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
from design.solids.topology import edge_faults
from firmware_profiles import Dish, load, shipped
from registration.devices.camera_frame import (
    Bath,
    CameraFrame,
    PrintedPoints,
    SeenMarks,
    Ties,
    TipView,
    Touch,
    check_frame,
    design_insert,
    find_tip,
    fit_frame,
    grounds,
    insert_solids,
    locate_tip,
)
from registration.devices.camera_frame.frame import turn_vector
from registration.devices.camera_frame.insert import Process, drawn
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
    frame = scene.fitted(printed=points, z_mm=4.1, u_z_mm=0.1)
    true = places(3.0)
    off = frame.to_printer(scene.optics().pixels(true), 3.0) - true[:, :2]
    assert np.linalg.norm(off, axis=1).max() < 0.03
    assert frame.tied == "printed"


def test_touches_that_dont_fit_or_scatter_are_refused_or_believed_less() -> None:
    with pytest.raises(PictureError, match="one touched cross doesn't say"):
        scene.fitted([Touch("left", 80, 90)])
    with pytest.raises(PictureError, match="no cross 'west'; it has left, right, front, back"):
        scene.fitted([Touch("west", 80, 90), Touch("left", 80, 90)])
    with pytest.raises(PictureError, match="the touched crosses don't fit the fiducial plate"):
        scene.fitted([Touch("left", 70, 90), Touch("right", 110, 90)])
    signs = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, -1], [1, 1, -1.0]])
    large, small = (scene.fitted(scene.touched(off * signs)).u_mm for off in (0.018, 0.002))
    assert large > 1.2 * small
    with pytest.raises(PictureError, match=r"they scatter .* times as much as touches good to 10"):
        scene.fitted(scene.touched(0.035 * signs))


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


# Checks of a frame by another picture.

HIDDEN = replace(scene.SCENE, hidden=[(-0.45, -0.35, 0.35)])


def test_an_unmoved_camera_passes_and_a_bump_of_100_um_is_noticed_with_marks_hidden() -> None:
    answer = check_frame(scene.shifted(0, 0, HIDDEN), scene.frame())
    assert answer.holds, answer.why
    assert answer.moved_um < 10
    assert answer.marks < len(scene.insert().marks)
    answer = check_frame(scene.shifted(0.07, -0.07, HIDDEN), scene.frame())
    assert not answer.holds
    assert abs(answer.moved_um - 100) < 10
    assert "camera or fiducial plate moved" in answer.why[0]


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


# Inserts: their design, files and bodies.


@pytest.mark.parametrize("name", shipped(Dish))
def test_marks_lie_around_every_dish_and_opencv_reads_them(name: str) -> None:
    insert = design_insert(load(Dish, name))
    assert len(insert.marks) >= 8
    corners = insert.corners().reshape(-1, 2)
    far = np.abs(corners) / (np.array(insert.hole_mm) / 2)
    outside = np.hypot(*far.T) > 1 if insert.shape == "round" else far.max(axis=1) > 1
    assert outside.all()
    assert (np.abs(corners) < np.array(insert.plate_mm) / 2).all()
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    seen, numbers, _ = cv2.aruco.ArucoDetector(book).detectMarkers(drawn(insert, 8.0))
    assert sorted(numbers.ravel().tolist()) == insert.numbers
    at = dict(zip(numbers.ravel().tolist(), seen, strict=True))
    for mark in insert.marks:
        middle = at[mark.number][0].mean(axis=0) / 8.0 - np.array(insert.plate_mm) / 2
        np.testing.assert_allclose(middle, (mark.x_mm, -mark.y_mm), atol=0.15)


def test_the_bodies_are_closed_and_flush() -> None:
    insert = design_insert(load(Dish, "petri_35mm"))
    white, black = insert_solids(insert)
    for body in (white, black):
        faults = edge_faults(body.faces)
        assert not faults.open
        assert not faults.wrong
        assert body.vertices[:, 2].max() == pytest.approx(3.0)
    with pytest.raises(PictureError, match=r"less than 0\.2 mm of a plate of 0\.5 mm"):
        insert_solids(design_insert(load(Dish, "petri_35mm"), thickness_mm=0.5))


def test_a_measured_length_sets_the_scale_and_a_wrong_one_is_refused() -> None:
    insert = design_insert(load(Dish, "petri_60mm"))
    left, right = insert.crosses[:2]
    length = right.x_mm - left.x_mm
    measured = insert.measured("left", 0.996 * length, 0.03)
    assert measured.scale == pytest.approx(0.996)
    assert measured.u_scale == pytest.approx(0.03 / length)
    with pytest.raises(PictureError, match="made at 100 %"):
        insert.measured("left", 0.9 * length, 0.03)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"hole_mm": 30.0}, "no wider than the dish inside"),
        ({"mark_mm": 50.0}, "marks 3 to 30 mm"),
        ({"mark_mm": 3.0}, "take larger ones"),
    ],
)
def test_inserts_that_cant_be_are_refused(words: dict[str, float], said: str) -> None:
    with pytest.raises(PictureError, match=said):
        design_insert(load(Dish, "petri_100mm"), **words)


# The needle's tip in painted pictures.


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
    seen_as = {"size_px": camera.size, "focal_px": camera.focal, "centre_px": camera.axis}
    seen_as |= {"distortion": (*camera.k, *camera.p, 0.0)}
    spread = np.diag([1e-7] * 3 + [3e-3] * 3 + [1e-9] * 8) ** 2
    known = {"lens": scene.lens().model_copy(update=seen_as), "eye_mm": tuple(camera.centre)}
    known |= {"turn_vector": tuple(turn_vector(camera.rotation))}
    known |= {"covariance": tuple(tuple(row) for row in spread.tolist())}
    return scene.frame().model_copy(update=known)


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


def test_no_needle_is_not_found_and_a_wrong_place_of_one_picture_refused() -> None:
    rng = np.random.default_rng(6)
    bare = developed(rough_ground(optics().size, rng, 160.0, 10.0), Scene(), rng)
    with pytest.raises(PictureError, match="needle"):
        find_tip(bare, frame(), PLACES[0], OUTER, reach_mm=1.0)
    with pytest.raises(PictureError, match="the camera looks along the needle"):
        find_tip(bare, frame(), optics().centre * [1, 1, 0] + [0.1, 0, 12], OUTER)
    views = seen()
    wrong = [*views[:3], TipView(frame(), views[3].seen, PLACES[3] + [1.0, 0, 0])]
    with pytest.raises(PictureError, match="picture 4 doesn't fit the others"):
        locate_tip(wrong, OUTER)
