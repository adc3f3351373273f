"""Checks of a frame by another picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from registration.devices.camera_frame import check_frame
from tests.registration.devices.camera_frame import scene

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


def test_a_picture_upside_down_is_told_as_turned() -> None:
    """It was told as "-200.41 % larger: zoom, focus or height changed"."""
    answer = check_frame(np.ascontiguousarray(scene.picture()[::-1, ::-1]), scene.frame())
    assert not answer.holds
    assert "turned " in answer.why[0]
    assert "180." in answer.why[0] or "179." in answer.why[0]


def test_another_focus_light_or_size_is_told() -> None:
    blurred = check_frame(scene.shifted(0, 0, replace(scene.SCENE, blur=2.6)), scene.frame())
    assert not blurred.holds
    assert "the focus changed" in blurred.why[0]
    dark = check_frame((0.25 * scene.picture()).astype(np.uint8), scene.frame())
    assert not dark.holds
    assert "set exposure" in dark.why[0]
    half = check_frame(scene.picture()[::2, ::2], scene.frame(), "half.png")
    assert not half.holds
    assert "calibrated at 1000 x 800" in half.why[0]


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
