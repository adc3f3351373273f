"""A print's device is tried before anything moves, and the empty dish is kept."""

from __future__ import annotations

import sys
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
import yaml

from printctl.errors import UsageError
from printctl.observe import __main__ as starting
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.order import ObserverOrder
from printctl.observe.process import try_device
from printctl.observe.records import look_folder
from printctl.observe.view_before import EMPTY
from sim.errors import SimError
from sim.gcode.motion.executed import ExecutedMotion

CAMERA = {
    "camera": {"size_px": [60, 40], "um_per_px": 100, "target_mm": [50, 40, 1]},
    "scene": {
        "bath": {"texture": 0, "colour": [100, 100, 100]},
        "ink": {"colour": [220, 220, 220]},
        "sensor": {"mono": True},
    },
    "laid": {"printer": "generic_marlin", "syringe": "hamilton_1ml", "layer_mm": 0.1},
}


def print_before(path: Path) -> None:
    """Record of an earlier print in the same folder: one line of 5 mm."""
    places = np.array([[47.5, 40.0, 1.0], [52.5, 40.0, 1.0]])
    ends = np.array([0.0, 0.5])
    ExecutedMotion(
        places[:1], places[1:], ends[:1], ends[1:], ends[:1], ends[1:], np.zeros(1, np.int64)
    ).save(path)


def test_a_simulated_camera_shows_no_ink_of_the_print_before(
    tmp_path: Path,
) -> None:
    record, camera = tmp_path / "executed.npz", tmp_path / "camera.yaml"
    camera.write_text(yaml.safe_dump(CAMERA))
    print_before(record)
    extra = {"camera": str(camera), "record": str(record)}
    order = ObserverOrder(
        job="", profile="generic_marlin", syringe="hamilton_1ml", ink="collagen_fresh",
        needle="fresh_150um", embedded=False, oct=False, frame="",
        device=DeviceSettings("simulated", extra=extra), limits=Limits(),
    )  # fmt: skip
    try_device(order, tmp_path)
    seen = cv2.imread(str(look_folder(tmp_path, EMPTY) / "picture.png"), cv2.IMREAD_UNCHANGED)
    assert np.ptp(cv2.GaussianBlur(seen, (0, 0), 3)) < 40


def test_a_refusal_of_several_lines_is_told_in_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = tmp_path / "cut.yaml"
    frame.write_text("printer_to_scan: [[1, 2")
    job = tmp_path / "job.gcode"
    job.write_text("G21\nG90\nM82\nG1 X1 Y1 Z1 F600\n")
    ObserverOrder(
        job=str(job), profile="generic_marlin", syringe="hamilton_1ml", ink="collagen_fresh",
        needle="fresh_150um", embedded=False, oct=True, frame=str(frame),
        device=DeviceSettings("command", "true {out}"), limits=Limits(),
    ).save(tmp_path)  # fmt: skip
    for name in ("ignore_signals", "signal"):  # of a process of its own
        monkeypatch.setattr(starting, name, Mock())
    monkeypatch.setattr(sys, "argv", ["printctl.observe", str(tmp_path)])
    assert starting.main() == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert str(frame) in said
    assert "four rows of four numbers" in said


def test_a_laser_lines_frame_or_field_is_read_before_the_print(tmp_path: Path) -> None:
    def order(frame: str, device: DeviceSettings) -> ObserverOrder:
        return ObserverOrder(
            job="", profile="generic_marlin", syringe="hamilton_1ml", ink="collagen_fresh",
            needle="fresh_150um", embedded=False, oct=False, laser=True, frame=frame,
            device=device, limits=Limits(),
        )  # fmt: skip

    frame, field = tmp_path / "frame.yaml", tmp_path / "laser.yaml"
    frame.write_text(yaml.safe_dump({"printer_to_scan": np.eye(4).tolist(), "pixel_um": 20}))
    with pytest.raises(UsageError, match="pixel_um means nothing"):
        try_device(order(str(frame), DeviceSettings("folder", str(tmp_path))), tmp_path)
    frame.write_text(yaml.safe_dump({"printer_to_scan": np.eye(4).tolist()}))
    try_device(order(str(frame), DeviceSettings("folder", str(tmp_path))), tmp_path)
    field.write_text("low_mm: [0, 0, 0]")
    simulated = DeviceSettings("simulated", extra={"laser_line": str(field)})
    with pytest.raises(SimError, match="high_mm"):
        try_device(order("", simulated), tmp_path)
