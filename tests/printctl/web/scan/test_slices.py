"""Slice pictures of a scan, against plain NumPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from printctl.web.errors import NotFoundError
from printctl.web.scan.findings import alignment, findings
from printctl.web.scan.slices import TINT, Slices, picture, plane
from registration.files.readers import write_scan_tiff
from registration.scan import Scan

SHAPE = (5, 7, 9)


def _scan() -> Scan:
    volume = np.arange(np.prod(SHAPE), dtype=np.uint16).reshape(SHAPE)
    return Scan(
        volume=volume,
        voxel_mm=(0.04, 0.03, 0.02),
        refractive_index=1.0,
        optical_depth=False,
        scale="linear",
        modality="microct",
        depth_down=False,
        came_from=Path("scan"),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    place = tmp_path / "scan.tif"
    write_scan_tiff(place, _scan())
    return place


@pytest.mark.parametrize("index", [0, 2, 4])
def test_slices_are_those_of_the_volume(index: int) -> None:
    volume = _scan().volume
    np.testing.assert_array_equal(plane(volume, "z", index), volume[index])
    np.testing.assert_array_equal(plane(volume, "y", index), volume[:, index])
    np.testing.assert_array_equal(plane(volume, "x", index), volume[:, :, index])


def test_what_is_above_the_threshold_is_tinted() -> None:
    image = np.array([[0.0, 10.0], [20.0, 30.0]])
    seen = picture(image, 0.0, 30.0, threshold=20.0)
    np.testing.assert_array_equal(seen[0, 1], [85, 85, 85])
    np.testing.assert_array_equal(seen[1, 1], [(255 + part) // 2 for part in TINT])
    assert (seen[1, 0] != seen[1, 0, 0]).any()


def test_a_changed_scan_is_read_again(path: Path) -> None:
    slices = Slices()
    before = slices.open(path)
    path.with_suffix(".json").write_text('{"modality": "confocal"}')
    assert before.scan.modality == "microct"
    assert slices.open(path).scan.modality == "confocal"


# --- registration findings in words
def _turned(degrees: float) -> list[list[float]]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return [[c, -s, 0, 1.5], [s, c, 0, -2.25], [0, 0, 1, 0.125], [0, 0, 0, 1]]


NUMBERS: dict[str, Any] = {
    "transform_scan_to_part": _turned(30.0),
    "scale": [0.99, 1.0, 1.01],
    "interval_95": {"rotation_deg": [0.01, 0.02], "shift_um": [1.0, 4.0], "scale": [0.001]},
    "rigid": {"rms_um": 30.5, "p95_um": 75.4},
    "ambiguity": {"flag": False},
    "vessels": [
        {
            "vessel": 0,
            "designed_um": 1000,
            "measured_um": 980,
            "error_percent": -2,
            "open": True,
            "decision": "pass",
        },
        {
            "vessel": 1,
            "designed_um": 400,
            "measured_um": 300,
            "error_percent": -25,
            "open": True,
            "decision": "fail",
        },
        {"vessel": 2, "designed_um": 400, "measured_um": 100, "error_percent": -75, "open": False},
        {"vessel": 3, "designed_um": 400, "measured_um": None, "open": None},
    ],
    "verdict": {"passed": False, "reasons": ["Vessel 2 is closed"]},
}


def test_pose_scales_and_intervals_are_told_with_units() -> None:
    said = dict(alignment(NUMBERS))
    assert said["Turned by"] == "30.00° (± 0.02 °, 95 %)"
    assert said["Shifted by x, y, z"] == "1.500, −2.250, 0.125 mm (± 4 µm, 95 %)"
    scale = said["Part against design along x, y, z"]
    assert scale == "99.00 %, 100.00 %, 101.00 % (± 0.1 %, 95 %)"
    assert said["Pose"] == "unambiguous"
    assert said["RMS deviation, rigid fit"] == "30.5 µm; 95 % of it within 75.4 µm"


@pytest.mark.parametrize("text", ["", "{", "[1]"])
def test_without_a_registration_there_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "registration.json").write_text(text)
    with pytest.raises(NotFoundError, match="no scan is registered"):
        findings(tmp_path)
