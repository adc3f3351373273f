"""Tolerance zones of known shapes, and the reference frame of a part, laid on datums."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from registration import RegistrationReport, Scan, register_scan, report_dict
from registration.alignment import Fit
from registration.errors import DatumError
from registration.measuring.geometry import Characteristic, Scene, read_datums
from registration.measuring.geometry.lumen import closed_filtered, open_filter
from report.sections.measurement_tables import frame_lines, zone_table
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
from tests.registration.parts import bent_network, lumens, solid
from tests.registration.registered import FAST, bent_lumens

BARREL_MM = 0.03
PRINTED = (
    Printed((0, 1.0, 1.3), (8, 1.1, 1.3)),
    Printed((0, 2.4, 1.2), (8, 2.4, 1.2), lambda t: BARREL_MM * (1 - (2 * t - 1) ** 2)),
    Printed((0, 3.95, 1.4), (8, 3.95, 1.4)),
)


@cache
def printed(noise_mm: float = 0.0, seed: int = 0) -> tuple[Characteristic, ...]:
    lower = np.array([0.01, 0.0, -0.04])
    return measured(scene(segmented(PRINTED, low=lower, noise_mm=noise_mm, seed=seed)))


def test_position_of_a_tilted_or_shifted_axis_is_twice_its_largest_distance() -> None:
    found = zone(printed(), "axis", "vessel 0")
    # 0.1 mm off at the far end; the last section stands about 0.25 mm before it.
    assert found.zone_um == pytest.approx(200 * (8 - 0.25) / 8, abs=3)
    for name, feature in (("axis", "vessel 2"), ("port", "inlet 2"), ("port", "outlet 2")):
        assert zone(printed(), name, feature).zone_um == pytest.approx(100, abs=1)


def test_cylindricity_counts_a_barrel_and_neither_tilt_nor_shift() -> None:
    barrel = zone(printed(), "cylindricity", "vessel 1").zone_um
    assert 1e3 * BARREL_MM * 0.8 < barrel < 1e3 * BARREL_MM
    assert zone(printed(), "cylindricity", "vessel 0").zone_um < 1.5
    assert zone(printed(), "cylindricity", "vessel 2").zone_um < 1.5


def test_profile_of_a_lumen_or_a_leaning_face_is_twice_the_largest_deviation() -> None:
    assert zone(printed(), "lumen", "vessel 1").zone_um == pytest.approx(2e3 * BARREL_MM, abs=2)
    assert zone(printed(), "lumen", "vessel 2").zone_um == pytest.approx(100, abs=2)
    # 0.01 x - 0.04: 40 µm off at both ends, less what the edges and the filter leave out.
    assert zone(printed(), "face", "face \N{MINUS SIGN}z").zone_um == pytest.approx(74, abs=3)
    assert zone(printed(), "face", "face +z").zone_um < 1


@pytest.mark.slow
def test_intervals_hold_the_truth_under_noise() -> None:
    clean = printed()
    rows = [row for seed in range(2) for row in printed(0.006, seed)]
    true = [zone(clean, row.name, row.feature).zone_um for row in rows]
    missed = [
        (row, value)
        for row, value in zip(rows, true, strict=True)
        if not row.low_um - 1 <= value <= row.high_um + 1
    ]
    # Of 42 intervals of 95 % more than four miss in one of 20 trials.
    assert len(missed) <= 4, missed


@pytest.mark.slow
def test_noise_makes_a_flat_zone_larger_and_its_interval_reaches_zero() -> None:
    noisy = zone(printed(0.006), "cylindricity", "vessel 2")
    assert noisy.zone_um > 5
    assert noisy.low_um < 1


def test_a_wave_of_the_cut_offs_length_keeps_half() -> None:
    angle = 2 * np.pi * np.arange(48) / 48
    wave = closed_filtered(np.cos(7 * angle), 7.0)
    assert np.ptp(wave) / 2 == pytest.approx(0.5, abs=0.01)
    along = np.linspace(0, 20, 801)
    kept = open_filter(along, 1.0) @ np.cos(2 * np.pi * along)
    assert np.ptp(kept[200:600]) / 2 == pytest.approx(0.5, abs=0.01)


# Datums.


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
    leaning = first.fit.rotation[[0, 2], [2, 0]]
    assert leaning.min() == pytest.approx(-0.01, abs=2e-4)
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


def test_a_face_or_an_axis_that_was_not_seen_is_refused() -> None:
    found = segmented()
    found.seen[found.surface.vertices[:, 2] < 0.4] = False
    with pytest.raises(DatumError, match=r"face .z isn't seen: 0 % of it"):
        frame(scene(found), *read_datums(["face -z", "face -x", "face -y"]))
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


# Datums by recipe and command: a scan of lumens alone, laid on its axes and mouths.

NETWORK = bent_network()
Registered = tuple[Scan, RegistrationReport]


@pytest.fixture(scope="module")
def registered(tmp_path_factory: pytest.TempPathFactory) -> Registered:
    return bent_lumens(tmp_path_factory)


@pytest.mark.slow
def test_the_chosen_datums_lay_the_rigid_fit_and_not_the_scaled_one(registered):
    scan, plain = registered
    datums = read_datums(["axis 0", "outlet 4"])
    chosen = register_scan(scan, solid(lumens(NETWORK)), NETWORK, replace(FAST, datums=datums))
    assert plain.frame.names == ()
    assert chosen.frame.names == ("axis 0", "outlet 4")
    assert chosen.scaled_scan_to_part == pytest.approx(plain.scaled_scan_to_part)
    assert np.abs(chosen.transform_scan_to_part - plain.transform_scan_to_part).max() > 1e-4
    # The datum's own vessel lies where it is designed, though the print has shrunk by 2 %.
    by_name = {(one.name, one.feature): one for one in chosen.characteristics}
    assert by_name["axis", "vessel 0"].zone_um < 40
    assert by_name["port", "outlet 4"].zone_um < 15
    assert by_name["cylindricity", "vessel 0"].zone_um < 40
    numbers = report_dict(chosen)
    assert frame_lines(numbers)[0].startswith("Datums: axis 0 (primary), outlet 4 (secondary)")
    table = zone_table(numbers)
    assert table is not None
    assert len(table.rows) == len(chosen.characteristics)


@pytest.mark.slow
def test_lumens_scanned_alone_have_no_outer_face_to_be_a_datum(registered: Registered) -> None:
    options = replace(FAST, datums=read_datums(["face -z"]))
    with pytest.raises(DatumError, match=r"no planar outer face .* \(it has: none\)"):
        register_scan(registered[0], solid(lumens(NETWORK)), NETWORK, options)
