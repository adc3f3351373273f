"""Reference frame of a part, laid on datums."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration.alignment import Fit
from registration.errors import DatumError
from registration.measuring.geometry import Scene, read_datums
from tests.registration.measuring.geometry.shapes import (
    AS_DESIGNED,
    BLOCK,
    Printed,
    frame,
    measured,
    scene,
    segmented,
    zone,
)

TURN = Rotation.from_rotvec([0.004, -0.006, 0.005]).as_matrix()
POSE = Fit(TURN, np.array([0.05, -0.03, 0.04]), np.ones(3), BLOCK / 2)
"""Scan to part: what the frame must come to, from a best fit that is off by it."""


@cache
def posed() -> Scene:
    return scene(segmented(AS_DESIGNED, pose=POSE))


@pytest.mark.parametrize(
    "datums",
    [
        "face -z, face -x, face -y",
        "face +y, face +z, face +x",
        "face -z, axis 1, inlet 1",
        "axis 0, face -z, outlet 2",
        "ports",
        "inlet 0, outlet 0, outlet 2",
        "inlet 2, outlet 1, face +z",
    ],
)
def test_a_sound_part_is_laid_where_it_is_by_any_datums(datums: str) -> None:
    found = frame(posed(), *read_datums(datums.split(",")))
    corners = np.array([[x, y, z] for x in (0, 8) for y in (0, 5) for z in (0, 2.6)])
    off = found.fit.apply(corners) - POSE.apply(corners)
    assert np.abs(off).max() < 0.004


def test_each_datum_settles_only_what_those_before_it_left_free() -> None:
    # The upper face leans by 10 mrad about y: as primary it tilts the part, as secondary it can't.
    there = scene(segmented(high=np.array([0.01, 0.0, 2.6])))
    first = frame(there, *read_datums(["face +z", "face -x", "face -y"]))
    second = frame(there, *read_datums(["face -z", "face -x", "face -y"]))
    assert first.fit.rotation[0, 2] == pytest.approx(-0.01, abs=2e-4) or first.fit.rotation[
        2, 0
    ] == pytest.approx(-0.01, abs=2e-4)
    assert np.abs(second.fit.rotation - np.eye(3)).max() < 2e-4


def test_position_is_told_from_the_datums_and_not_from_the_best_fit() -> None:
    moved = (*AS_DESIGNED[:2], Printed((0, 3.95, 1.4), (8, 3.95, 1.4)))
    there = scene(segmented(moved))
    by_faces = measured(there, *read_datums(["face -z", "face -x", "face -y"]))
    by_axis = measured(there, *read_datums(["face -z", "axis 2", "face -x"]))
    assert zone(by_faces, "axis", "vessel 2").zone_um == pytest.approx(100, abs=2)
    assert zone(by_axis, "axis", "vessel 2").zone_um < 2
    assert zone(by_axis, "axis", "vessel 0").zone_um == pytest.approx(100, abs=2)


@pytest.mark.slow
def test_interval_of_each_datums_place_is_given() -> None:
    there = scene(segmented(noise_mm=0.006))
    places = frame(there, *read_datums(["face -z", "axis 1", "inlet 1"])).places
    assert [name for name, _, _ in places] == ["face \N{MINUS SIGN}z", "axis 1", "inlet 1"]
    assert all(0.05 < u < 20 and moved < 10 for _, u, moved in places)


@pytest.mark.parametrize(
    ("datums", "said"),
    [
        ("face -z", "3 of 6 .*still free: shift along x, shift along y, turn about z;"),
        ("face -z, face +z", "still free: shift along x, shift along y, turn about z;"),
        ("axis 0", "4 of 6 .*still free: shift along x, turn about x;"),
        ("face -z, axis 0", "5 of 6 .*still free: shift along x;"),
        ("inlet 0, outlet 0", "still free: turn about x;"),
        ("axis 7", "the design has vessels 0 to 2"),
        ("outlet 9", "no such mouth in the design; it has inlet 0, outlet 0"),
    ],
)
def test_what_cannot_hold_the_part_is_refused_and_said(datums: str, said: str) -> None:
    with pytest.raises(DatumError, match=said):
        frame(posed(), *read_datums(datums.split(",")))


def test_a_face_that_was_not_seen_is_refused() -> None:
    found = segmented()
    found.seen[found.surface.vertices[:, 2] < 0.4] = False
    with pytest.raises(DatumError, match=r"face .z isn't seen: 0 % of it"):
        frame(scene(found), *read_datums(["face -z", "face -x", "face -y"]))


def test_an_axis_that_was_not_seen_is_refused_with_those_that_were() -> None:
    whole = posed()
    wall = whole.cuts[1].outlines.wall.copy()
    wall[6:] = np.nan
    cut = replace(whole.cuts[1], outlines=replace(whole.cuts[1].outlines, wall=wall))
    found = replace(whole, cuts=(whole.cuts[0], cut, *whole.cuts[2:]))
    with pytest.raises(DatumError, match=r"axis 1 isn't seen: .*with so many: 0, 2"):
        frame(found, *read_datums(["face -z", "axis 1"]))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["face z"], "isn't known"),
        (["top"], "isn't known"),
        (["face -z", "face -z"], "given twice"),
        (["face -z", "face -x", "face -y", "axis 0"], "4 datums are given, of at most 3"),
    ],
)
def test_names_that_are_none_are_refused(given: list[str], said: str) -> None:
    with pytest.raises(DatumError, match=said):
        read_datums(given)
