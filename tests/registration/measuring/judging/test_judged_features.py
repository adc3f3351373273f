"""Decisions on the RMS, on lumens beside their axis and on leaks."""

from __future__ import annotations

import numpy as np
import pytest

from registration.measuring.judging import Tolerances, VesselLimits, judge, judge_plain, reason
from tests.registration.measuring.judging.registered import change, registration, vessel

SURE = 8.0
"""Half width, µm, of sections that a budget knows well."""


@pytest.mark.parametrize(
    ("rms", "u", "decision"),
    [(60, 30, "pass"), (90, 30, "undecided"), (120, 30, "undecided"), (150, 30, "fail"),
     (20, None, "undecided"), (150, None, "undecided")],
)  # fmt: skip
def test_the_rms_is_judged_with_its_interval_and_not_without(
    rms: float, u: float | None, decision: str
) -> None:
    numbers = registration(vessel(0, np.zeros(20), u_um=SURE), scaled={"rms_um": rms})
    found = judge_plain(numbers | {"rms_interval_95_um": u}, 100.0, 10.0)
    (feature,) = (f for f in found["judging"]["features"] if f["name"] == "rms")
    assert feature["decision"] == decision


@pytest.mark.parametrize(
    ("widths", "u", "decision"),
    [(60, 20, "pass"), (90, 20, "undecided"), (160, 20, "fail"), (160, None, "undecided")],
)
def test_widths_may_differ_by_the_diameters_whole_tolerance(
    widths: float, u: float | None, decision: str
) -> None:
    row = vessel(0, np.zeros(20), u_um=SURE, oval_um=widths, oval_interval_95_um=u)
    found = judge_plain(registration(row), 100.0, 10.0)  # ± 50 of 500 µm
    (feature,) = (f for f in found["judging"]["features"] if f["name"] == "oval")
    assert (feature["upper_um"], feature["decision"]) == (100.0, decision)
    assert found["vessels"][0]["decision"] == decision


@pytest.mark.parametrize(
    ("aside", "limits", "decision"),
    [
        (120.0, {}, "pass"),  # less than half the radius of 250 µm
        (140.0, {}, "pass"),  # not beyond it by more than U
        (245.0, {}, "undecided"),
        (245.0, {"offset_um": 60.0}, "undecided"),  # the mean is within it, which hides the place
        (245.0, {"profile_um": 600.0}, "pass"),
        (245.0, {"position_um": 600.0}, "pass"),
    ],
)
def test_a_lumen_far_beside_its_axis_never_passes_without_a_limit(
    aside: float, limits: dict[str, float], decision: str
) -> None:
    offsets = np.full(40, 5.0)
    offsets[20:26] = aside
    row = vessel(
        0,
        np.zeros(40),
        u_um=SURE,
        offset_along_um=[None, *offsets[1:].tolist()],
        offset_interval_95_um=20.0,
    )
    found = judge(registration(row), Tolerances(VesselLimits(**limits)))
    assert found["vessels"][0]["decision"] == decision
    told = [reason(f) for f in found["judging"]["features"] if f.get("doubt") == "no limit"]
    if decision == "undecided":
        assert told == [
            "Vessel 0, 2.5 mm along: the lumen lies 245 ± 20 µm beside its designed axis, "
            "more than half its radius, and no limit is given; say what is allowed (position_um)"
        ]


def test_a_leak_whose_interval_leaves_room_for_none_is_undecided() -> None:
    """172 ± 1194 µm beside a slanted mouth failed a sound print (2026-11-26)."""
    leak = change(0, 1.0, 1.2) | {"kind": "leak", "size_um": 172.0, "error_um": 1194.0}
    found = judge_plain(
        registration(vessel(0, np.zeros(20), u_um=SURE), defects=[leak]), 100.0, 10.0
    )
    assert [d["decision"] for d in found["findings"]] == ["undecided"]
    (feature,) = (f for f in found["judging"]["features"] if f["name"] == "leak")
    assert "leaves room for none" in reason(feature)


def test_a_leak_fails_where_none_is_allowed() -> None:
    leak = change(0, 1.0, 1.2) | {"kind": "leak", "size_um": 200.0}
    found = judge_plain(
        registration(vessel(0, np.zeros(20), u_um=SURE), defects=[leak]), 100.0, 10.0
    )
    assert [d["decision"] for d in found["findings"]] == ["fail"]
