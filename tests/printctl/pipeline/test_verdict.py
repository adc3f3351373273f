"""Verdict on a print: pass, fail, undecided."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from printctl.pipeline.plate.results import plate_verdict, well_figures
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


ALL_ALONG = np.full(20, -80.0)
NARROW, CLOSED = np.zeros(40), np.zeros(40)
NARROW[18:22] = -110.0
CLOSED[18:20] = -500.0
LEAK = change(1, 1.9, 2.1) | {"kind": "leak", "size_um": 200.0, "error_um": 12.0}
BRIDGE = change(0, 1.9, 2.1) | {"kind": "bridge", "other": 1, "size_um": 178.0, "error_um": 33}
MISSING = change(1, 0.0, 4.0) | {"kind": "missing"}
GONE = {**vessel(1, np.full(20, -500.0), u_um=8.0), "open": False}
SAME = {"flag": True, "rivals": [{"lead": 1.0, "same": True, "mirrored": False}]}
OTHER = {"foreign_share": 0.66, "designed_open": 0.13, "close_share": 0.92, "other_part": True}


def unfed(*numbers: int) -> dict[str, Any]:
    rows = [{**row, "fed": row["vessel"] not in numbers} for row in FLOW["vessels"]]  # type: ignore[attr-defined]
    return {"perfusion": FLOW | {"vessels": rows}}


@pytest.mark.parametrize(
    ("second", "more", "verdict_is", "words"),
    [
        (good(1), {}, "passed", ["1.20 (interval not known) times", "2 of 2 vessels pass"]),
        (good(1), {"defects": [change(1, 1.0, 1.5)]}, "passed", ["No leak, and no bridge"]),
        (good(1), {"scaled": {"rms_um": 130.0}}, "failed", []),
        (good(1, open=False), {}, "failed", ["Vessel 1: closed"]),
        (GONE, {"defects": [MISSING]}, "failed", ["Vessel 1 is missing"]),
        (vessel(1, ALL_ALONG, u_um=8.0), {}, "failed", ["nearly all along, by 16.0 %"]),
        (vessel(1, NARROW, u_um=8.0), {}, "failed", ["−22.0 ± 1.6 % (−110 ± 8 µm), limit ±10 %"]),
        (vessel(1, CLOSED, u_um=8.0), {}, "failed", ["closed, with 500 µm designed"]),
        (good(1), {"defects": [LEAK]}, "failed", ["Vessel 1, 2.0 mm along: a way 200 ± 12 µm"]),
        (good(1), {"defects": [BRIDGE]}, "failed", ["178 ± 33 µm wide leads into vessel 1"]),
        (good(1), {"defects": [LEAK | {"doubt": "shade"}]}, "undecided", ["not proven"]),
        (good(1), unfed(0), "failed", ["1 vessel carries no flow as printed: 0"]),
        (good(1), unfed(0, 1), "failed", ["2 vessels carry no flow as printed: 0, 1"]),
        (good(1, open=False), {"ambiguity": {"flag": True}}, "undecided", ["if the pose is right"]),
        (good(1, open=False), {"ambiguity": SAME}, "failed", ["Vessel 1: closed"]),
        (good(1, open=None, unseen_mm=[[0.5, 0.9]]), {}, "undecided",
         ["neither open nor closed", "not seen at 0.5 to 0.9 mm", "is fed isn't known"]),
        (vessel(1, np.full(20, -40.0), u_um=20.0), {"judging": CONFORMANCE}, "undecided",
         ["measured −8.0 ± 4.0 %", "limit ±10 %: neither proven", "probability of 79 %"]),
        (good(1), {"agreement": OTHER, "scale": [1.08, 0.94, 0.95]}, "failed", ["66 %", "13 %"]),
    ],
)  # fmt: skip
def test_a_print_is_judged_with_its_reasons(
    second: dict[str, Any], more: dict[str, Any], verdict_is: str, words: list[str]
) -> None:
    found = judged(good(0), second, **more)
    assert found["passed"] == (verdict_is == "passed")
    assert found["undecided"] == (verdict_is == "undecided")
    said = "; ".join(found["reasons"])
    assert all(word in said for word in words), said


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


def test_what_has_a_limit_is_not_called_unjudged() -> None:
    placed = VesselLimits(position_um=60.0)
    (said,) = not_judged(Tolerances(placed))
    assert "position_um" not in said
    assert not_judged(Tolerances(placed, face_profile_um=100.0)) == []


def test_unseen_vessel_beside_a_failure_is_a_failure() -> None:
    result = judged(good(0, -100.0), good(1, open=None))
    assert (result["passed"], result["undecided"]) == (False, False)
    assert not any("Every vessel is fed" in reason for reason in result["reasons"])


@pytest.mark.parametrize(("defect", "vessels"), [(LEAK, [1]), (BRIDGE, [0, 1])])
def test_a_way_out_fails_the_vessels_that_it_joins(defect: Any, vessels: list[int]) -> None:
    rows = judge_plain(
        registration(good(0), good(1), perfusion=FLOW, defects=[defect]), 100.0, 10.0
    )["vessels"]
    assert [row["vessel"] for row in rows if row["decision"] == "fail"] == vessels


def test_of_an_ambiguous_pose_it_isnt_said_that_there_are_no_leaks() -> None:
    reasons = judged(good(0), ambiguity={"flag": True})["reasons"]
    assert not any(reason.startswith("No leak") for reason in reasons)


@pytest.mark.parametrize(("count", "more"), [(1, "1 more fails"), (20, "20 more fail")])
def test_many_reasons_are_counted(count: int, more: str) -> None:
    result = judged(*(good(n, open=False) for n in range(MOST_REASONS + count)))
    assert sum(reason.endswith("closed") for reason in result["reasons"]) == MOST_REASONS
    assert any(reason.startswith(more) for reason in result["reasons"])


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


# --- verdict on a plate, from the verdicts on its wells
def well(passed: bool, undecided: bool) -> dict[str, Any]:
    verdict = {"passed": passed, "undecided": undecided, "reasons": ["Vessel 0: open"]}
    numbers = {"vessels": [{"error_percent": 1.0}], "scaled": {"rms_um": 9.0}}
    found = well_figures({"verdict": verdict, "registration": numbers})
    return {"well": "A1", "label": "one", **found}


GOOD, OPEN, BAD = well(True, False), well(False, True), well(False, False)


@pytest.mark.parametrize(
    ("wells", "passed", "undecided"),
    [
        ([GOOD, GOOD], True, False),
        ([GOOD, OPEN], False, True),
        ([OPEN, BAD], False, False),
        ([BAD, GOOD], False, False),
    ],
)
def test_one_undecided_well_leaves_the_plate_undecided(
    wells: list[dict[str, Any]], passed: bool, undecided: bool
) -> None:
    found = plate_verdict(wells, 3)
    assert (found["passed"], found["undecided"]) == (passed, undecided)
    assert found["reasons"][0].startswith(f"A1 (one) {wells[0]['outcome']}: Vessel 0")
    assert "1 of 3 wells weren't scanned" in found["reasons"][-1]
