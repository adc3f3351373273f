"""OCT calibration: known distortion recovered from a grid and a step; file round trip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration.devices.optics import (
    GridView,
    OctCalibration,
    find_grid,
    fit_grid,
    measure_step,
    read_calibration,
    with_step,
    write_calibration,
)
from registration.errors import ScanFileError, SegmentationError
from registration.wall_reference import WallCalibration
from tests.registration.devices.optics.optical import FAULT, blank, dots, reflecting

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


def test_the_dots_are_found_where_they_are(views: list[GridView]) -> None:
    for view in views:
        assert len(view.points) >= 49
        spans = np.ptp(view.index, axis=0)
        assert (spans >= 6).all()
        assert len(np.unique(view.index, axis=0)) == len(view.index)


def test_fan_bow_and_scale_are_found(views: list[GridView]) -> None:
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
    flat = reflecting(
        blank((64, 150, 160), VOXEL), OctCalibration(), lambda x, y: 0.6 + 0 * x, dots(PITCH, 0.0)
    )
    with pytest.raises(SegmentationError, match="--pitch-um"):
        find_grid(flat, 0.9)
    plain = reflecting(
        blank((64, 80, 80), VOXEL),
        OctCalibration(),
        lambda x, y: 0.6 + 0 * x,
        lambda x, y: 40 + 0 * x,
    )
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
