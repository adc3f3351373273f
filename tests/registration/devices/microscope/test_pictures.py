"""Widths and gaps measured in synthetic pictures."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from registration.devices.lens.perspective import mapped
from registration.devices.microscope import (
    Crossing,
    Line,
    Target,
    find_view,
    measure_gaps,
    measure_lines,
    read_picture,
)
from registration.errors import PictureError
from tests.registration.devices.microscope.rendered import Camera, Painted, paint, view_of
from tests.slower import first_of

SIZE = (16.0, 13.0)
WIDTHS = {1: 0.22, 2: 0.30, 3: 0.26, 4: 0.40}
HEIGHTS = {1: 3.0, 2: 5.0, 3: 7.0, 4: 9.0}
FRAME = (
    [[0, 13], [0, 0], [16, 0]],
    [[16, 6.5], [16, 13], [8, 13]],
)


def drawn() -> list[Painted]:
    lines = [Painted(np.array(one, float), np.full(3, 0.28)) for one in FRAME]
    for number, y in HEIGHTS.items():
        ends = np.array([[3, y], [13, y]], float)
        lines.append(Painted(ends, np.full(2, WIDTHS[number])))
    return lines


def target() -> Target:
    points = [np.linspace(a, b, 60) for one in FRAME for a, b in pairwise(one)]
    points += [np.linspace([3, y], [13, y], 60) for y in HEIGHTS.values()]
    return Target(SIZE, 0.28, 3.0, np.concatenate(points))


def lines() -> list[Line]:
    return [
        Line(number, np.array([[3, y], [13, y]], float), 0.28, 0.8, 0.14)
        for number, y in HEIGHTS.items()
    ]


def saved(folder: Path, image: np.ndarray) -> Path:
    path = folder / "picture.png"
    assert cv2.imwrite(str(path), image)
    return path


CAMERAS = [
    Camera(um_per_px=20, turn_deg=7, tilt=0.04, light=0.4, noise=0.03),
    Camera(um_per_px=25, turn_deg=-95, mirrored=True, bright=True, per_mm=5.0, noise=0.02),
    Camera(um_per_px=20, turn_deg=183, tilt=-0.05, per_mm=1.0, noise=0.03, blur_px=1.5),
]


@pytest.mark.parametrize("camera", first_of(CAMERAS))
def test_widths_come_back_from_a_picture(camera: Camera, tmp_path: Path) -> None:
    picture = read_picture(saved(tmp_path, paint(drawn(), camera, SIZE, seed=3)))
    view = find_view(picture, target())
    true, _ = view_of(camera, SIZE)
    off = mapped(view.matrix, target().points) - mapped(true, target().points)
    assert np.abs(off).max() < 0.5
    assert view.mirrored == camera.mirrored
    assert view.um_per_px == pytest.approx(camera.um_per_px, rel=2e-3)
    found, shade = measure_lines(picture, view, lines())
    for one in found:
        aim = WIDTHS[one.line.number]
        assert one.found == 1
        assert float(np.median(one.width_mm)) == pytest.approx(aim, abs=max(5e-3, 0.02 * aim))
    assert shade.opaque(0.28) == (camera.per_mm is None)


def test_gaps_come_back_and_closed_ones_are_nought(tmp_path: Path) -> None:
    gaps, wide = [-0.05, 0.1, 0.2, 0.4], 0.3
    y = 4.0 + np.cumsum([0, *(gap + wide for gap in gaps)])
    teeth = [Painted(np.array([[3, at], [13, at]], float), np.full(2, wide)) for at in y]
    picture = read_picture(saved(tmp_path, paint([*drawn()[:2], *teeth], CAMERAS[0], SIZE)))
    own = np.concatenate([target().points[:240], *(np.linspace([3, at], [13, at], 60) for at in y)])
    view = find_view(picture, Target(SIZE, 0.28, 3.0, own))
    x = np.linspace(6, 10, 5)
    asked = [
        Crossing(k, np.stack([np.column_stack([x, 0 * x + y[k + end]]) for end in (0, 1)], 1))
        for k in range(len(gaps))
    ]
    found = measure_gaps(picture, view, asked, 150.0 * 0.8, 0.0)
    np.testing.assert_array_equal(found[0].open_mm, 0)
    for one, gap in zip(found[1:], gaps[1:], strict=True):
        assert float(np.median(one.open_mm)) == pytest.approx(gap, abs=0.012)


def test_pictures_of_something_else_are_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(90, 110, (600, 800)).astype(np.uint8)
    with pytest.raises(PictureError, match="nothing stands out"):
        read_picture(saved(tmp_path, noise))
    for place in rng.integers(80, 520, (9, 2)).tolist():
        cv2.circle(noise, place, 40, 20, -1)
    with pytest.raises(PictureError, match="--pattern"):
        find_view(read_picture(saved(tmp_path, noise)), target())
    fewer = paint(drawn()[:2], CAMERAS[0], SIZE)  # a frame, and no lines in it
    with pytest.raises(PictureError, match="isn't found"):
        find_view(read_picture(saved(tmp_path, fewer)), target())
    (tmp_path / "words.png").write_text("words")
    with pytest.raises(PictureError, match="isn't a picture"):
        read_picture(tmp_path / "words.png")
