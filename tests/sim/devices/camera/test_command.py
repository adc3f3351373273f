"""The simulated camera as a device: one look at a printer's record."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import yaml

from registration import read_scan
from sim.__main__ import main
from sim.gcode.motion.executed import ExecutedMotion

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
    where, plunger = np.array(points), np.concatenate([[0.0], np.cumsum(volumes)]) / AREA
    time = np.arange(len(where), dtype=float)
    ExecutedMotion(
        where[:-1], where[1:], plunger[:-1], plunger[1:], time[:-1], time[1:],
        np.arange(len(volumes)),
    ).save(path)  # fmt: skip


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
