"""Decisions on geometric characteristics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from printctl.pipeline.verdict import verdict
from printctl.recipe.tolerances import TolerancesPart
from registration.measuring.judging import Rule, judge
from tests.registration.measuring.judging.registered import registration, vessel


def row(name: str, low: float, high: float, **more: Any) -> dict[str, Any]:
    return {
        "name": name, "characteristic": "position of the axis", "feature": "vessel 0", "vessel": 0,
        "zone_um": (low + high) / 2, "interval_95_um": [low, high], "seen_fraction": 1.0,
        "note": "", **more,
    }  # fmt: skip


def judged(*rows: dict[str, Any], **limits: Any) -> dict[str, Any]:
    numbers = registration(vessel(0, np.zeros(20)), characteristics=list(rows))
    return judge(numbers, TolerancesPart.model_validate(limits).tolerances(100.0, 10.0, Rule()))


@pytest.mark.parametrize(
    ("low", "high", "decision"), [(10, 40, "pass"), (30, 60, "undecided"), (70, 90, "fail")]
)
def test_a_zone_is_decided_by_its_interval(low: float, high: float, decision: str) -> None:
    found = judged(row("axis", low, high), position_um=50)
    assert found["characteristics"][0]["decision"] == decision
    assert found["vessels"][0]["decision"] == decision


def test_what_is_not_defined_is_not_judged_and_what_is_not_known_is_undecided() -> None:
    none = {"zone_um": None, "interval_95_um": [None, None]}
    curved = row("cylindricity", 0, 0, **none | {"note": "not defined: the design is curved"})
    unseen = row("cylindricity", 0, 0, **none | {"note": "too few whole sections were measured"})
    found = judged(curved, unseen, cylindricity_um=20)["characteristics"]
    assert [one["decision"] for one in found] == [None, "undecided"]


def test_a_face_that_was_seen_in_part_is_no_pass() -> None:
    face = row("face", 5, 20, vessel=None, feature="face +x", seen_fraction=0.6)
    found = judged(face, face_profile_um=50)
    assert found["characteristics"][0]["decision"] == "undecided"
    assert any("Face +x" in text for text in verdict(found)["reasons"])
    assert any("not all of it was seen" in text for text in verdict(found)["reasons"])


def test_a_fail_is_among_the_verdicts_reasons() -> None:
    reasons = verdict(judged(row("axis", 70, 90), position_um=50))["reasons"]
    assert reasons[0] == (
        "Vessel 0: position of the axis 80 µm (70 to 90 µm, 95 %), limit at most 50 µm: "
        "proven beyond it"
    )
