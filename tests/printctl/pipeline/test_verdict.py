"""Verdict on a print: pass, fail, undecided."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from printctl.pipeline.verdict import MOST_REASONS, verdict
from registration.measuring.judging import Tolerances, VesselLimits, judge, judge_plain
from tests.registration.measuring.judging.registered import (
    CONFORMANCE,
    change,
    registration,
    vessel,
)

FLOW = {
    "pressure_drop_pa": 12.0,
    "designed_pressure_drop_pa": 10.0,
    "vessels": [{"vessel": v, "fed": True, "share": 0.52, "designed_share": 0.5} for v in (0, 1)],
}


def good(number: int, error: float = 5.0, **more: Any) -> dict[str, Any]:
    return vessel(number, np.full(20, error), u_um=8.0, **more)


def judged(*vessels: dict[str, Any], **more: Any) -> dict[str, Any]:
    numbers = registration(*(vessels or (good(0), good(1))), perfusion=FLOW) | more
    return verdict(judge_plain(numbers, 100.0, 10.0))


def test_good_print_passes_and_says_why() -> None:
    result = judged()
    assert result["passed"]
    assert not result["undecided"]
    assert any(
        "1.20 (interval not known) times the designed pressure" in reason
        for reason in result["reasons"]
    )
    assert any("2 of 2 vessels pass" in reason for reason in result["reasons"])


def not_judged(tolerances: Tolerances) -> list[str]:
    faces = {"outer_faces": {"scaled": {"p95_um": 21.2, "max_um": 508.0}}}
    numbers = registration(good(0), good(1), perfusion=FLOW, by_surface=faces)
    reasons = verdict(judge(numbers, tolerances))["reasons"]
    return [reason for reason in reasons if reason.startswith("Not judged")]


def test_a_pass_says_that_place_and_outer_faces_were_not_judged() -> None:
    (said,) = not_judged(Tolerances())
    assert "where lumens lie (position_um)" in said
    assert "outer faces (face_profile_um), of which 95 % lie within 21 µm" in said
    assert said.endswith("the farthest place is 508 µm off")


def test_places_that_stand_out_are_told_with_or_without_a_limit() -> None:
    pit = {"at_mm": [1.0, -2.04, 2.6], "deviation_um": 350.4, "area_mm2": 0.8}
    excess = {"at_mm": [0.0, 0.0, 0.0], "deviation_um": -120.0, "area_mm2": 0.3}
    faces = {"outer_faces": {"scaled": {"max_um": None}, "places": [pit, excess, pit, pit]}}
    numbers = registration(good(0), good(1), perfusion=FLOW, by_surface=faces)
    for tolerances in (Tolerances(), Tolerances(face_profile_um=500.0)):
        (said,) = (r for r in verdict(judge(numbers, tolerances))["reasons"] if "Away" in r)
        assert "gel missing by 350 µm over 0.8 mm² at x 1.0, y −2.0, z 2.6 mm" in said
        assert "gel in excess by 120 µm over 0.3 mm²" in said
        assert said.endswith("; 1 more")


@pytest.mark.parametrize(
    "surfaces",
    [None, {}, {"outer_faces": None}, {"outer_faces": {"scaled": {"max_um": None}}}],
)
def test_outer_faces_that_were_not_seen_are_named_without_a_figure(surfaces: Any) -> None:
    numbers = registration(good(0), good(1), perfusion=FLOW, by_surface=surfaces)
    reasons = verdict(judge(numbers, Tolerances()))["reasons"]
    assert any(reason.endswith("outer faces (face_profile_um)") for reason in reasons)


def test_what_has_a_limit_is_not_called_unjudged() -> None:
    placed = VesselLimits(position_um=60.0)
    (said,) = not_judged(Tolerances(placed))
    assert "position_um" not in said
    assert not_judged(Tolerances(placed, face_profile_um=100.0)) == []


def test_closed_vessel_fails() -> None:
    result = judged(good(0), good(1, open=False))
    assert not result["passed"]
    assert not result["undecided"]
    assert result["reasons"][0] == "Vessel 1: closed"


def test_a_missing_lumen_is_called_missing_and_no_more() -> None:
    gone = change(1, 0.0, 4.0) | {"kind": "missing"}
    closed = vessel(1, np.full(20, -500.0), u_um=8.0)
    result = judged(good(0), {**closed, "open": False}, defects=[gone])
    about = [one for one in result["reasons"] if one.startswith("Vessel 1")]
    assert about == ["Vessel 1 is missing: no lumen was found along it"]


def test_a_lumen_off_all_along_is_told_as_that() -> None:
    result = judged(good(0), vessel(1, np.full(20, -80.0), u_um=8.0))
    assert "nearly all along, by 16.0 % in the mean" in result["reasons"][0]


def test_unseen_vessel_is_neither_passed_nor_called_closed() -> None:
    result = judged(good(0), good(1, open=None, unseen_mm=[[0.5, 0.9]]))
    assert not result["passed"]
    assert result["undecided"]
    assert "neither open nor closed" in result["reasons"][0]
    assert "not seen at 0.5 to 0.9 mm" in result["reasons"][1]


def test_unseen_vessel_beside_a_failure_is_a_failure() -> None:
    result = judged(good(0, -100.0), good(1, open=None))
    assert not result["passed"]
    assert not result["undecided"]


def test_undecided_is_told_with_value_interval_and_limit() -> None:
    result = judged(good(0), vessel(1, np.full(20, -40.0), u_um=20.0), judging=CONFORMANCE)
    assert result["undecided"]
    said = result["reasons"][0]
    assert said.startswith("Vessel 1, ")
    assert "measured −8.0 ± 4.0 %" in said
    assert "limit ±10 %: neither proven (the vessel conforms with a probability of 79 %)" in said


def test_a_local_change_beyond_the_limit_fails_and_is_named() -> None:
    errors = np.zeros(40)
    errors[18:22] = -110.0
    result = judged(good(0), vessel(1, errors, u_um=8.0))
    assert not result["passed"]
    assert "Vessel 1, 2." in result["reasons"][0]
    assert "−22.0 ± 1.6 % (−110 ± 8 µm), limit ±10 %" in result["reasons"][0]


def test_leak_fails_and_is_named() -> None:
    leak = change(1, 1.9, 2.1) | {"kind": "leak", "size_um": 200.0, "error_um": 12.0}
    result = judged(defects=[leak])
    assert not result["passed"]
    (reason,) = [r for r in result["reasons"] if "leads out" in r]
    assert "Vessel 1, 2.0 mm along: a way 200 ± 12 µm wide" in reason
    row = next(row for row in result_rows(leak) if row["vessel"] == 1)
    assert (row["decision"], row["conformance"]) == ("fail", 0.0)
    assert "of their sections the one farthest off: Vessel 0" in "; ".join(result["reasons"])


def result_rows(*defects: dict[str, Any]) -> list[dict[str, Any]]:
    numbers = registration(good(0), good(1), perfusion=FLOW, defects=list(defects))
    rows: list[dict[str, Any]] = judge_plain(numbers, 100.0, 10.0)["vessels"]
    return rows


def test_a_bridge_leads_into_its_other_vessel_and_not_out() -> None:
    bridge = change(0, 1.9, 2.1) | {"kind": "bridge", "other": 1, "size_um": 178.0, "error_um": 33}
    reasons = judged(defects=[bridge])["reasons"]
    assert reasons[0] == (
        "Vessel 0, 2.0 mm along: a way 178 ± 33 µm wide leads into vessel 1, none allowed"
    )
    assert [row["decision"] for row in result_rows(bridge)] == ["fail", "fail"]


def test_what_may_be_a_shadow_is_undecided() -> None:
    leak = change(1, 1.9, 2.1) | {"kind": "leak", "size_um": 200.0, "error_um": 12.0}
    result = judged(defects=[leak | {"doubt": "shade"}])
    assert result["undecided"]
    assert not result["passed"]
    assert "not proven, as gel below a bubble or a particle looks alike" in result["reasons"][0]


def test_a_closed_section_is_called_closed_and_not_an_unknown_percentage() -> None:
    errors = np.zeros(40)
    errors[18:20] = -500.0
    row = vessel(0, errors, u_um=8.0, designed_um=500.0)
    reasons = judged(row)["reasons"]
    assert "closed, with 500 µm designed, limit ±10 %" in reasons[0]
    assert not any("unknown" in reason or "100.0" in reason for reason in reasons)


def test_local_change_within_the_tolerance_passes() -> None:
    assert judged(defects=[change(1, 1.0, 1.5)])["passed"]


def test_rms_beyond_its_limit_fails() -> None:
    assert not judged(scaled={"rms_um": 130.0})["passed"]


def test_of_an_ambiguous_pose_nothing_is_proven() -> None:
    bad = good(0, open=False)
    found = judged(bad, ambiguity={"flag": True})
    assert not found["passed"]
    assert found["undecided"]
    assert "Vessel 0: closed, if the pose is right" in found["reasons"]


def test_of_an_ambiguous_pose_it_isnt_said_that_there_are_no_leaks() -> None:
    said = "No leak, and no bridge between vessels, was found"
    assert said in judged(good(0))["reasons"]
    assert said not in judged(good(0), ambiguity={"flag": True})["reasons"]


def test_a_symmetric_part_fails_whichever_way_it_lies() -> None:
    same = {"flag": True, "rivals": [{"lead": 1.0, "same": True, "mirrored": False}]}
    found = judged(good(0, open=False), ambiguity=same)
    assert not found["undecided"]
    assert "Vessel 0: closed" in found["reasons"]


def test_starved_vessel_fails() -> None:
    rows = [dict(FLOW["vessels"][0], fed=False), FLOW["vessels"][1]]  # type: ignore[index]
    result = judged(perfusion=FLOW | {"vessels": rows})
    assert not result["passed"]
    assert result["reasons"][0] == "1 vessel carries no flow as printed: 0"
    both = [dict(row, fed=False) for row in FLOW["vessels"]]  # type: ignore[attr-defined]
    result = judged(perfusion=FLOW | {"vessels": both})
    assert result["reasons"][0] == "2 vessels carry no flow as printed: 0, 1"


def test_flow_through_a_vessel_that_is_neither_open_nor_closed_isnt_claimed() -> None:
    result = judged(good(0), good(1, open=None))
    assert result["undecided"]
    assert not any("Every vessel is fed" in reason for reason in result["reasons"])
    (said,) = [reason for reason in result["reasons"] if "is fed isn't known" in reason]
    assert said.startswith("Vessel 1 is neither open nor closed")
    assert "1.20 (interval not known) times the designed pressure" in said


def test_pose_and_flow_are_told_however_many_vessels_are_undecided() -> None:
    rows = [vessel(n, np.full(20, -40.0), u_um=20.0) for n in range(MOST_REASONS + 3)]
    rows[0]["open"] = None
    reasons = judged(*rows, ambiguity={"flag": True})["reasons"]
    assert any(reason.startswith("The pose is ambiguous") for reason in reasons)
    assert any("is fed isn't known" in reason for reason in reasons)


def test_one_reason_left_out_is_counted_in_the_singular() -> None:
    result = judged(*(good(n, open=False) for n in range(MOST_REASONS + 1)))
    assert any(reason.startswith("1 more fails") for reason in result["reasons"])


def test_many_reasons_are_counted() -> None:
    result = judged(*(good(n, open=False) for n in range(30)))
    closed = [reason for reason in result["reasons"] if reason.endswith("closed")]
    assert len(closed) == MOST_REASONS
    assert any(reason.startswith("20 more fail") for reason in result["reasons"])


def shifted(sizes: list[float], errors: list[float], scale: float) -> dict[str, Any]:
    """Verdict on straight vessels of those diameters, each off by so much all along."""
    rows = [
        vessel(n, np.full(20, error), designed_um=size, u_um=8.0)
        for n, (size, error) in enumerate(zip(sizes, errors, strict=True))
    ]
    return judged(*rows, scale=[scale] * 3, judging=CONFORMANCE)


SIZES = [300.0, 400.0, 500.0, 600.0, 700.0, 800.0] * 5


@pytest.mark.parametrize(
    ("errors", "scale", "said"),
    [
        ([-0.15 * s for s in SIZES], 0.86, ("by 15.0 %", "as the whole part shrank (by 14.0 %)")),
        ([-80.0] * 30, 0.99, ("by 80 µm, whatever their width", "isn't shrinkage")),
        ([80.0] * 30, 0.99, ("wider than designed throughout", "by 80 µm")),
    ],
)
def test_one_shift_of_all_lumens_is_one_sentence(
    errors: list[float], scale: float, said: tuple[str, ...]
) -> None:
    result = shifted(SIZES, errors, scale)
    (cause,) = result["causes"]
    assert result["reasons"][0] == cause
    assert all(text in cause for text in said)
    assert sum(" mm along: diameter" in one for one in result["reasons"]) == MOST_REASONS


def test_the_worst_fails_are_listed_first() -> None:
    errors = [0.0] * 40
    errors[30], errors[12] = -160.0, -90.0
    result = shifted([500.0] * 40, errors, 1.0)
    assert result["causes"] == []
    fails = [one for one in result["reasons"] if "proven beyond" in one]
    assert [one.split(",")[0] for one in fails] == ["Vessel 30", "Vessel 12"]


def test_a_registration_that_wasnt_judged_is_refused() -> None:
    with pytest.raises(KeyError, match="judging"):
        verdict(registration(good(0)))


def test_of_another_part_s_scan_that_is_the_first_thing_said_and_a_fail() -> None:
    other = {"foreign_share": 0.66, "designed_open": 0.13, "close_share": 0.92, "other_part": True}
    result = judged(agreement=other, scale=[1.08, 0.94, 0.95])
    assert (result["passed"], result["undecided"]) == (False, False)
    assert len(result["reasons"]) == 1
    said = result["reasons"][0]
    assert said.startswith("This is not that part")
    assert "66 %" in said
    assert "13 %" in said
