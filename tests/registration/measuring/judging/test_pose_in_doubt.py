"""Doubtful pose: no decision says fail."""

from __future__ import annotations

from typing import Any

import numpy as np

from registration.measuring.judging import Tolerances, VesselLimits, judge, judge_plain
from tests.registration.measuring.judging.registered import change, registration, vessel

DOUBTFUL = {"flag": True, "rivals": [{"lead": 1.1, "same": False}]}
SYMMETRIC = {"flag": True, "rivals": [{"lead": 1.0, "same": True}]}


def bad(ambiguity: dict[str, Any]) -> dict[str, Any]:
    """Return a judged print with a failed diameter, a closure and a leak, and a sound vessel."""
    leak = change(0, 1.0, 1.2) | {"kind": "leak", "size_um": 200.0}
    gone = change(1, 0.0, 2.4) | {"kind": "missing", "size_um": 500.0}
    rows = [
        vessel(0, np.full(20, -150.0), u_um=8.0),
        vessel(1, np.full(20, -500.0), open=False),
        vessel(2, np.zeros(20), u_um=8.0),
    ]
    zone = {
        "name": "face", "vessel": None, "feature": "face +z", "characteristic": "profile",
        "zone_um": 300.0, "interval_95_um": [290.0, 310.0], "seen_fraction": 1.0, "note": "",
    }  # fmt: skip
    numbers = registration(
        *rows, defects=[leak, gone], ambiguity=ambiguity, scaled={"rms_um": 300.0},
        characteristics=[zone],
    )  # fmt: skip
    return judge(numbers, Tolerances(VesselLimits(), face_profile_um=50.0))


def decisions(found: dict[str, Any]) -> dict[str, list[str]]:
    judging, rows = found["judging"], found["vessels"]
    return {
        "print": [judging["decision"]],
        **{
            key: [one["decision"] for one in found[key]]
            for key in ("vessels", "findings", "defects", "characteristics")
        },
        "features": [one["decision"] for one in judging["features"]],
        "sections": [one for row in rows for one in row["decision_along"]],
    }


def test_nothing_fails_and_what_would_is_undecided() -> None:
    sure, doubtful = decisions(bad({"flag": False})), decisions(bad(DOUBTFUL))
    for key, before in sure.items():
        assert "fail" in before, key
        assert doubtful[key] == ["undecided" if one == "fail" else one for one in before], key


def test_a_symmetric_part_fails_whichever_way_it_lies() -> None:
    assert decisions(bad(SYMMETRIC)) == decisions(bad({"flag": False}))


def test_a_sound_print_in_a_doubtful_pose_isnt_a_pass() -> None:
    numbers = registration(vessel(0, np.zeros(20), u_um=8.0), ambiguity=DOUBTFUL)
    found = judge_plain(numbers, 100.0, 10.0)
    assert found["judging"]["decision"] == "undecided"
    assert found["vessels"][0]["decision"] == "pass"
