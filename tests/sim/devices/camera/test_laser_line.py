"""The simulated laser line profiler: heights, shadows, lost points, and the device as a command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from sim.__main__ import main
from sim.devices.camera.laser_line import ProfilerField, measured_heights
from sim.devices.recorded_ink import InkSource
from sim.gcode.deposit.lay import Laid
from sim.gcode.deposit.strands import Strands
from sim.gcode.deposit.written import Layering
from tests.sim.devices.camera.test_command import CAMERA, record

SOURCE = {"printer": "generic_marlin", "syringe": "hamilton_1ml", "layer_mm": 0.1}
IDEAL: dict[str, Any] = {
    "low_mm": (0, 0, -1), "high_mm": (6, 4, 3), "plate_z_mm": 0.5, "pixel_um": (20, 20),
    "noise_um": 0, "spot_um": 0, "wet": 0, "lost_per_mm2": 0, "tilt": (0, 0),
    "laid": InkSource(**SOURCE),
}  # fmt: skip


def field(**changes: Any) -> ProfilerField:
    return ProfilerField(**{**IDEAL, **changes})


@pytest.fixture
def ink() -> Laid:
    """A line of 0.06 mm² along x at y 2, its tip 0.2 mm over the plate."""
    start, end = np.array([[1.0, 2.0, 0.7]]), np.array([[5.0, 2.0, 0.7]])
    lines = Strands.dosed(start, end, np.array([0.24]), np.zeros(1, int), np.ones(1, int))
    return Laid(lines, Layering(np.array([0.7]), np.array([0.2])))


def test_a_line_stands_where_and_as_high_as_it_was_written(ink: Laid) -> None:
    heights, to_map = measured_heights(ink, field(), 1)
    column, row, _ = np.array([3.0, 2.0, 0.7]) @ to_map[:3, :3].T + to_map[:3, 3]
    across = heights[:, round(column / 0.02)]
    assert across[round(row / 0.02)] == pytest.approx(0.2, abs=0.002)
    assert across[10] == pytest.approx(0.0, abs=1e-6)
    ridge = np.flatnonzero(across > 0.1) * 0.02
    # (w - h) h + π h²/4 = A
    assert np.ptp(ridge) + 0.02 == pytest.approx(0.3 + 0.2 * (1 - np.pi / 4), abs=0.04)
    assert (ridge[0] + ridge[-1]) / 2 == pytest.approx(row, abs=0.012)


def test_the_camera_sees_nothing_in_a_lines_shadow(ink: Laid) -> None:
    """It looks from +y: to -y of the line as much is lost as its shoulder is high, at 45°."""
    across = measured_heights(ink, field(angle_deg=45, steepest_deg=89), 1)[0][:, 150]
    lost = np.flatnonzero(np.isnan(across))
    seen = np.flatnonzero(across > 0.1)
    assert 0.1 < len(lost) * 0.02 < 0.2
    assert lost.max() <= seen.min()


def test_what_is_seen_differs_from_look_to_look_and_not_by_chance(ink: Laid) -> None:
    noisy = field(noise_um=4, wet=0.2, lost_per_mm2=2, tilt=(0.01, 0))
    one, again, other = (measured_heights(ink, noisy, seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(np.isnan(one), np.isnan(other))
    left, right = np.nanmedian(one[:, :20]), np.nanmedian(one[:, -20:])
    assert right - left == pytest.approx(0.01 * 5.6, abs=0.002)
    plate = one[20:60, 130:170]
    assert np.nanstd(plate) == pytest.approx(0.004, rel=0.2)
    assert 0 < np.isnan(one).mean() < 0.2


def test_a_look_measures_what_a_fault_left(tmp_path: Path) -> None:
    record(tmp_path / "executed.npz")
    said = {
        "low_mm": [47, 38.5, 0], "high_mm": [53, 41.5, 2], "plate_z_mm": 0.9,
        "pixel_um": [25, 25], "laid": CAMERA["laid"],
    }  # fmt: skip
    (tmp_path / "laser.yaml").write_text(yaml.safe_dump(said))
    (tmp_path / "faults.yaml").write_text("ink: [{fault: clog, written_mm: 5, lasts_mm: 5}]")
    words = ["laser_line", "--record", str(tmp_path / "executed.npz"), "--faults"]
    words += [str(tmp_path / "faults.yaml"), "--laser_line", str(tmp_path / "laser.yaml"), "--out"]
    assert main([*words, str(tmp_path / "seen.npz"), "--low=48,38.5,0", "--high=52,41.5,2"]) == 0
    with np.load(tmp_path / "seen.npz") as file:
        heights, to_map = file["height_mm"], file["printer_to_scan"]
    for y, ink in ((39.0, True), (40.0, False), (41.0, True)):
        row = round((y + to_map[1, 3]) / 0.025)
        assert (np.nanmedian(heights[row]) > 0.05) == ink
    assert main([*words, str(tmp_path / "seen.tif")]) == 2
