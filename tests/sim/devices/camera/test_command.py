"""Simulated camera, OCT and laser line profiler as devices: one look at a printer's record."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from gcode.deposit.lay import Laid
from gcode.deposit.written import Layering, Strands
from registration import read_scan
from sim.__main__ import main
from sim.devices.camera.laser_line import ProfilerField, measured_heights
from sim.devices.recorded_ink import InkSource
from tests.sim.motions import moved

AREA = 4.15  # about a Hamilton 1 mL syringe's; what is asked here is where ink is, not how much
CAMERA = {
    "camera": {"size_px": [300, 200], "um_per_px": 25, "target_mm": [50, 40, 1]},
    "scene": {
        "bath": {"texture": 0, "colour": [100, 100, 100]},
        "ink": {"colour": [220, 220, 220]},
        "sensor": {"mono": True},
    },
    "laid": {"printer": "generic_marlin", "syringe": "hamilton_1ml", "layer_mm": 0.1},
}


def record(path, lines=3):
    """Lines of 5 mm, 1 mm apart, 0.1 µL a mm."""
    points, volumes = [(47.5, 39.0, 1.0)], []
    for number in range(lines):
        points += [(47.5, 39.0 + number, 1.0), (52.5, 39.0 + number, 1.0)]
        volumes += [0.0, 0.15]
    moved(points, volumes, AREA).save(path)


def look(tmp_path, *more, camera=CAMERA):
    (tmp_path / "camera.yaml").write_text(yaml.safe_dump(camera))
    words = ["camera", "--record", str(tmp_path / "executed.npz")]
    words += ["--camera", str(tmp_path / "camera.yaml"), "--out", str(tmp_path / "seen.png")]
    return main([*words, *map(str, more)])


def test_look_shows_the_ink_less_what_a_fault_took(tmp_path):
    record(tmp_path / "executed.npz")
    faults = tmp_path / "faults.yaml"
    faults.write_text("noise: 0.1\nink: [{fault: clog, written_mm: 5, lasts_mm: 5}]\n")
    assert look(tmp_path) == 0
    sound = cv2.imread(str(tmp_path / "seen.png"), cv2.IMREAD_UNCHANGED)
    assert look(tmp_path, "--faults", faults) == 0
    found = cv2.imread(str(tmp_path / "seen.png"), cv2.IMREAD_UNCHANGED)
    rows = [139, 99, 59]  # y 39, 40, 41 mm
    assert (sound[rows, 150] > 115).all()
    np.testing.assert_array_equal(found[rows, 150] > 115, [True, False, True])
    assert [path.name for path in tmp_path.glob(".*")] == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera": {"um_per_px": 25}}, "camera.size_px"),
        ({"laid": {"printer": "generic_marlin", "syringe": "none"}}, "none"),
        ({"scene": {"bath": {"colour": [1, 2, 3]}, "ink": {"colour": [1, 2, 3]}}}, "ink.colour"),
        ({"scene": {"fog": 1}}, "scene.fog"),
    ],
)
def test_what_means_nothing_is_refused(tmp_path, capsys, change, message):
    record(tmp_path / "executed.npz")
    assert look(tmp_path, camera=CAMERA | change) == 2
    assert message in capsys.readouterr().err


def test_oct_scans_a_fixed_field_of_a_begun_print(tmp_path):
    record(tmp_path / "executed.npz")
    field = {
        "low_mm": [47, 38.5, 0.6], "high_mm": [53, 41.5, 1.2], "voxel_um": [50, 50, 30],
        "laid": CAMERA["laid"],
    }  # fmt: skip
    (tmp_path / "oct.yaml").write_text(yaml.safe_dump(field))
    (tmp_path / "faults.yaml").write_text("ink: [{fault: clog, written_mm: 5, lasts_mm: 5}]")
    words = ["oct", "--record", str(tmp_path / "executed.npz"), "--oct", str(tmp_path / "oct.yaml")]
    words += ["--faults", str(tmp_path / "faults.yaml"), "--out", str(tmp_path / "seen.npz")]
    assert main(words) == 0
    scan = read_scan(tmp_path / "seen.npz")
    assert scan.volume.shape == (27, 60, 120)
    assert scan.depth_down
    with np.load(tmp_path / "seen.npz") as file:
        pose = file["printer_to_scan"]
    for y, ink in ((39.0, True), (40.0, False), (41.0, True)):
        places = np.column_stack(
            [np.arange(48, 52, 0.1), np.full(40, y), np.full(40, 0.95), np.ones(40)]
        )
        x, row, depth = (places @ pose.T)[:, :3].T / np.array([0.05, 0.05, 0.03 / 1.34])[:, None]
        seen = scan.volume[
            np.round(depth).astype(int), np.round(row).astype(int), np.round(x).astype(int)
        ]
        assert (seen.mean() > 1000) == ink
    record(tmp_path / "executed.npz", lines=0)
    assert main(words) == 0
    assert read_scan(tmp_path / "seen.npz").volume.mean() < 10


# Laser line profiler: heights, shadows, lost points


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
