"""The OCT's beam: refraction, known distortions recovered from a grid and a step."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from registration import RegistrationError, Scan
from registration.devices.optics import (
    Beam,
    GridView,
    OctCalibration,
    find_grid,
    find_surface,
    fit_grid,
    measure_step,
    read_calibration,
    refract,
    refraction_bound,
    undistort,
    with_step,
    write_calibration,
)
from registration.errors import ScanFileError, SegmentationError
from registration.wall_reference import WallCalibration
from tests.registration.devices.optics.optical import FAULT, blank, dots, reflecting, tilted
from tests.slower import examples, first_of


@given(
    angle=st.floats(0, 1.4), azimuth=st.floats(0, 6.3), index=st.floats(1.0, 2.0),
    lean=st.floats(-0.5, 0.5),
)  # fmt: skip
@settings(max_examples=examples(60), deadline=None)
def test_refraction_keeps_to_snells_law(angle, azimuth, index, lean):
    normal = np.array([math.sin(lean), 0.0, -math.cos(lean)])
    aside = np.array([math.cos(lean), 0.0, math.sin(lean)])
    third = np.cross(normal, aside)
    across = math.cos(azimuth) * aside + math.sin(azimuth) * third
    direction = -math.cos(angle) * normal + math.sin(angle) * across
    bent = refract(direction[None], normal[None], index)[0]
    assert np.linalg.norm(bent) == pytest.approx(1.0)
    assert index * np.linalg.norm(np.cross(bent, normal)) == pytest.approx(math.sin(angle))
    assert np.cross(bent, direction) @ normal == pytest.approx(0.0, abs=1e-9)


def test_the_bound_is_the_shift_of_a_straight_ray() -> None:
    aside, up = refraction_bound(10.0, 2.0, 1.34)
    surface = tilted(0.0, math.tan(math.radians(10.0)), 0.0)
    beam = Beam(OctCalibration(), np.zeros(2), 1.34, surface)
    (point,) = beam.to_true(np.array([[0.0, 0.0, 2.0 * 1.34]]))
    assert abs(point[0]) == pytest.approx(aside, rel=1e-6)
    assert 2.0 - point[2] == pytest.approx(up, rel=1e-6)
    assert aside > 0.08
    for tilt, index in ((-1.0, 1.3), (90.0, 1.3), (5.0, 0.9)):
        with pytest.raises(RegistrationError):
            refraction_bound(tilt, 1.0, index)


def test_what_is_too_steep_is_refused() -> None:
    steep = Beam(OctCalibration(fan_per_mm=(0.1, 0.0)), np.zeros(2), 1.0)
    with pytest.raises(RegistrationError, match="slope"):
        steep.to_true(np.array([[5.0, 0.0, 0.0]]))
    beam = Beam(OctCalibration(), np.zeros(2), 1.34, tilted(1.0, 0.9, 0.0))
    with pytest.raises(RegistrationError, match="steeper"):
        beam.to_true(np.array([[1.0, 1.0, 3.0]]))


@cache
def bead_scan(surface_tilt: float) -> tuple[Scan, np.ndarray]:
    """Bright beads at known true places in gel (index 1.34) below a tilted surface under air."""
    shape, voxel = (160, 60, 70), (0.02, 0.04, 0.04)
    surface = tilted(0.6, surface_tilt, 0.0)
    empty = replace(blank(shape, voxel), refractive_index=1.34)
    beam = Beam.of(empty, FAULT, surface)
    z, y, x = (np.arange(n) * s for n, s in zip(shape, voxel, strict=True))
    gz, gy, gx = np.meshgrid(z, y, x, indexing="ij")
    true = beam.to_true(np.stack([gx, gy, gz], axis=-1).reshape(-1, 3))
    beads = np.array([[0.7, 0.7, 1.2], [2.1, 0.8, 1.5], [0.8, 1.7, 1.7], [2.0, 1.6, 1.3]])
    level = np.where(gz > surface.depth_mm(gx, gy), 12.0, 0.0)
    for bead in beads:
        away = np.sum((true - bead) ** 2, axis=1).reshape(shape)
        level = level + 30 * np.exp(-0.5 * away / 0.06**2)
    noise = np.random.default_rng(0).normal(0, 0.5, shape)
    return replace(empty, volume=(level + noise).astype(np.float32)), beads


def centre_of(scan: Scan, near: np.ndarray) -> np.ndarray:
    voxel = np.array(scan.voxel_mm)
    at = np.round(near[::-1] / voxel).astype(int)
    half = np.round(0.2 / voxel).astype(int)
    box = tuple(slice(a - h, a + h + 1) for a, h in zip(at, half, strict=True))
    weight = np.maximum(scan.volume[box].astype(float) - 20.0, 0)
    places = np.indices(weight.shape).reshape(3, -1) @ weight.ravel() / weight.sum()
    return np.asarray(((places + at - half) * voxel)[::-1])


@pytest.mark.parametrize("tilt", first_of([0.12, 0.0]))
def test_beads_come_back_to_their_places(tilt: float) -> None:
    scan, beads = bead_scan(tilt)
    surface = find_surface(scan)
    assert surface.depth_mm(np.array([1.4]), np.array([1.2]))[0] == pytest.approx(
        0.6 + tilt * 1.4, abs=0.02
    )
    assert surface.tilt_deg == pytest.approx(math.degrees(math.atan(tilt)), abs=0.5)
    straight = undistort(scan, FAULT, surface)
    assert not straight.optical_depth
    assert "undone" in straight.notes[-1]
    # Where the grid begins is free, so distances between beads are what must be true.
    corners = np.array([[x, y, z] for x in (0, 2.76) for y in (0, 2.36) for z in (0, 3.18)])
    lowest = Beam.of(scan, FAULT, surface).to_true(corners).min(axis=0)
    found = np.array([centre_of(straight, bead - lowest) for bead in beads])
    for i in range(4):
        for j in range(i):
            expected = np.linalg.norm(beads[i] - beads[j])
            assert np.linalg.norm(found[i] - found[j]) == pytest.approx(expected, abs=0.006)


def test_a_view_full_of_liquid_shows_no_surface_under_air() -> None:
    scan, _ = bead_scan(0.0)
    full = replace(scan, volume=np.full_like(scan.volume, 12.0))
    with pytest.raises(SegmentationError, match="--air-above"):
        find_surface(full)


@given(seed=st.integers(0, 10**6), air=st.booleans(), index=st.floats(1.0, 1.6))
@settings(max_examples=examples(40), deadline=None)
def test_to_scan_is_the_inverse_of_to_true(seed: int, air: bool, index: float) -> None:
    rng = np.random.default_rng(seed)
    surface = tilted(1.0, *rng.uniform(-0.15, 0.15, 2)) if air else None
    beam = Beam(FAULT, np.array([2.5, 3.0]), index, surface)
    points = rng.uniform(0, 1, (50, 3)) * [5.0, 6.0, 4.0]
    np.testing.assert_allclose(beam.to_scan(beam.to_true(points)), points, atol=2e-5)


def test_above_the_surface_depth_is_not_divided() -> None:
    beam = Beam(OctCalibration(), np.zeros(2), 1.34, tilted(1.0, 0.0, 0.0))
    points = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0], [0.0, 0.0, 2.34]])
    np.testing.assert_allclose(beam.to_true(points)[:, 2], [0.5, 1.0, 2.0])


# Calibration from a grid and a step; its file.


PITCH = 0.5
SHAPE, VOXEL = (128, 150, 160), (0.02, 0.03, 0.03)


@pytest.fixture(scope="module")
def views() -> list[GridView]:
    """The target at two heights, a little tilted and turned."""
    found = []
    for height, seed in ((0.6, 1), (1.9, 2)):
        scan = reflecting(
            blank(SHAPE, VOXEL),
            FAULT,
            lambda x, y, h=height: h + 0.02 * (x - 2.4) - 0.01 * (y - 2.2),
            dots(PITCH, 0.06),
            seed,
        )
        found.append(find_grid(scan, PITCH))
    return found


def test_dots_fan_bow_and_scale_are_found(views: list[GridView]) -> None:
    for view in views:
        assert len(view.points) >= 49
        spans = np.ptp(view.index, axis=0)
        assert (spans >= 6).all()
        assert len(np.unique(view.index, axis=0)) == len(view.index)
    fit = fit_grid(views, PITCH)
    assert fit.fan_known
    found = fit.calibration
    np.testing.assert_allclose(found.lateral, FAULT.lateral, atol=0.0012)
    np.testing.assert_allclose(found.fan_per_mm, FAULT.fan_per_mm, atol=0.0008)
    np.testing.assert_allclose(found.bow_per_mm, FAULT.bow_per_mm, atol=0.0003)
    assert fit.lateral_um < 4 < fit.before_um
    assert fit.depth_um < 2
    low, high = found.intervals["scale_x"]
    assert low < found.lateral[0][0] < high


def test_the_wrong_pitch_is_noticed() -> None:
    level = OctCalibration(), lambda x, y: 0.6 + 0 * x
    flat = reflecting(blank((64, 150, 160), VOXEL), *level, dots(PITCH, 0.0))
    with pytest.raises(SegmentationError, match="--pitch-um"):
        find_grid(flat, 0.9)
    plain = reflecting(blank((64, 80, 80), VOXEL), *level, lambda x, y: 40 + 0 * x)
    with pytest.raises(SegmentationError):
        find_grid(plain, PITCH)


def step_scan(gap: float, slope: float, middle: float = 1.2) -> object:
    """Two levels, `gap` of path apart along z."""
    return reflecting(
        blank((128, 60, 80), VOXEL),
        OctCalibration(),
        lambda x, y: 0.5 + slope * x + np.where(x > middle, gap, 0.0),
        lambda x, y: 40 + 0 * x,
    )


@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_a_step_is_measured_square_to_its_levels(slope: float) -> None:
    step = measure_step(step_scan(1.0, slope))  # type: ignore[arg-type]
    assert step.path_mm == pytest.approx(1.0 / np.hypot(1, slope), abs=0.001)
    assert step.error_mm < 0.001
    assert step.tilt_deg == pytest.approx(np.degrees(np.arctan(slope)), abs=0.2)


def test_a_step_in_air_scales_depth_and_one_in_gel_gives_its_index() -> None:
    step = measure_step(step_scan(1.0, 0.0))  # type: ignore[arg-type]
    air = with_step(OctCalibration(), step, 1.02, immersed=False)
    assert air.depth_scale == pytest.approx(1.02, abs=0.002)
    assert not air.depth_standard
    low, high = air.intervals["depth_scale"]
    assert low < air.depth_scale < high
    gel = with_step(air, step, 0.75, immersed=True)
    assert gel.depth_standard
    assert gel.refractive_index == pytest.approx(1.02 / 0.75, abs=0.003)
    sure = with_step(air, step, 0.75, immersed=True, height_u_mm=0.015)
    assert sure.relative_error("refractive_index") == pytest.approx(0.01, rel=0.02)
    with pytest.raises(SegmentationError, match="--height-um"):
        with_step(OctCalibration(), step, 2.0, immersed=False)


def test_the_file_keeps_a_calibration(tmp_path: Path) -> None:
    full = OctCalibration(
        FAULT.lateral, FAULT.fan_per_mm, FAULT.bow_per_mm, 1.01, 1.337, True, {"a": (1.0, 2.0)},
        WallCalibration(4.5, 0.6, 400.0, 1000.0, 10, (25.0, 25.0, 15.0), "oct", "Acme", "GelMA"),
    )  # fmt: skip
    for calibration in (full, OctCalibration()):
        write_calibration(tmp_path / "c.yaml", calibration)
        assert read_calibration(tmp_path / "c.yaml") == calibration


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("printctl-oct-calibration-1", "other", "isn't a calibration"),
        ("depth_scale: 1.0", "depth_scale: .nan", "depth_scale"),
        ("depth_scale: 1.0", "depth_scale: 20", "0.5 to 2"),
        ("depth_scale: 1.0", "depth_scale: [", "not YAML"),
        ("depth_scale: 1.0", "colour: red", "unknown key"),
        ("depth_standard: false", "depth_standard: 1", "true or false"),
        ("intervals: {}", "intervals: {a: [1]}", "two numbers"),
        ("walls: null", "walls: {offset_um: 3}", "walls must hold"),
        (
            "walls: null",
            "walls: {offset_um: 300, interval_um: 1, from_um: 1, to_um: 2, scans: 1}",
            "offset_um is 300; it must be 1 number.* -100 to 100",
        ),
    ],
)
def test_a_broken_file_is_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    path = tmp_path / "c.yaml"
    write_calibration(path, OctCalibration())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ScanFileError, match=reason):
        read_calibration(path)
    with pytest.raises(ScanFileError, match="no calibration"):
        read_calibration(tmp_path / "none.yaml")
