"""Dish inserts: their design, files and bodies."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from design.solids.topology import edge_faults
from firmware_profiles import load, shipped
from firmware_profiles.plates import Dish
from registration.devices.camera_frame import (
    design_insert,
    insert_solids,
)
from registration.devices.camera_frame.insert import drawn
from registration.errors import PictureError


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
