"""Registration findings in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from printctl.web.errors import NotFoundError
from printctl.web.scan.findings import alignment, findings


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


def test_each_vessel_has_a_verdict(tmp_path: Path) -> None:
    (tmp_path / "registration.json").write_text(json.dumps(NUMBERS))
    found = findings(tmp_path)
    assert found.passed is False
    assert found.reasons == ("Vessel 2 is closed",)
    assert found.outcome == "fail"
    assert [one.verdict for one in found.vessels] == [
        "pass: open",
        "fail: open",
        "closed",
        "not seen",
    ]


@pytest.mark.parametrize("text", ["", "{", "[1]"])
def test_without_a_registration_there_are_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "registration.json").write_text(text)
    with pytest.raises(NotFoundError, match="no scan is registered"):
        findings(tmp_path)
