"""Decisions on sections, vessels and prints against tolerances."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from registration.measuring.judging import (
    DecisionRule,
    Limit,
    Override,
    Rule,
    ToleranceError,
    Tolerances,
    VesselLimits,
    judge,
    judge_plain,
    reason,
    withhold_unsure,
)
from tests.registration.measuring.judging.registered import GUARDED, change, registration, vessel
from tests.slower import examples

SURE = 8.0
"""Half width, µm, of sections that a budget knows well."""


def judged(*vessels: dict[str, Any], **more: Any) -> dict[str, Any]:
    return judge_plain(registration(*vessels, judging=GUARDED, **more), 100.0, 10.0)


def noise(n: int, sd: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, sd, n)


def test_a_clean_vessel_passes_and_leaves_no_finding() -> None:
    found = judged(vessel(0, noise(30, 3.0), u_um=SURE))
    assert found["judging"]["decision"] == "pass"
    assert found["vessels"][0]["decision"] == "pass"
    assert found["findings"] == []


def test_a_change_over_half_a_vessel_fails_as_one_finding() -> None:
    errors = noise(40, 3.0) + np.where(np.arange(40) >= 20, -105.0, 0.0)
    found = judged(vessel(0, errors, u_um=SURE))
    (finding,) = found["findings"]
    assert (finding["kind"], finding["decision"]) == ("stenosis", "fail")
    assert finding["from_mm"] == pytest.approx(2.4)
    assert finding["to_mm"] == pytest.approx(4.8)
    assert finding["deviation_percent"] == pytest.approx(-21, abs=3)
    assert finding["tolerance_um"] == [-50, 50]
    assert finding["point_mm"][0] == pytest.approx(finding["at_mm"])


def test_a_narrow_vessel_fails_over_its_whole_length_though_it_is_alone() -> None:
    found = judged(vessel(0, noise(40, 3.0) - 90.0, u_um=SURE))
    (finding,) = found["findings"]
    assert finding["decision"] == "fail"
    assert (finding["from_mm"], finding["to_mm"]) == (0, pytest.approx(4.8))
    names = {f["name"] for f in found["judging"]["features"] if f["decision"] == "fail"}
    assert names == {"section", "mean"}


def test_what_lies_within_its_interval_of_a_limit_is_undecided() -> None:
    found = judged(vessel(0, np.full(30, -40.0), u_um=20.0))
    assert found["judging"]["decision"] == "undecided"
    assert {d["decision"] for d in found["findings"]} == {"undecided"}


def test_a_section_whose_interval_was_withdrawn_is_undecided_and_fails_nothing() -> None:
    row = vessel(0, np.zeros(20), u_um=SURE)
    row["interval_95_um"][7] = None
    found = judged(row)
    assert found["vessels"][0]["decision_along"][7] == "undecided"
    assert [d["decision"] for d in found["findings"]] == ["undecided"]
    # Nor though what the vessel's sections share is known.
    row = vessel(0, np.where(np.arange(30) == 4, 400.0, noise(30, 3.0)), u_um=SURE)
    row["interval_95_um"][4] = None
    row["measured_interval_95_um"] = SURE
    found = judged(row)
    assert found["vessels"][0]["decision_along"][4] == "undecided"
    assert found["judging"]["decision"] == "undecided"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("unseen_mm", "not visible in the scan from 1.0 to 1.4 mm"),
        ("gel_like_mm", "partly like gel from 1.0 to 1.4 mm"),
        ("unmeasured_mm", "no complete wall found from 1.0 to 1.4 mm"),
        ("unsure_mm", "may not follow the lumen from 1.0 to 1.4 mm"),
    ],
)
def test_what_wasnt_seen_or_measured_isnt_a_pass(name: str, said: str) -> None:
    found = judged(vessel(0, np.zeros(20), u_um=SURE, **{name: [[1.0, 1.4]]}))
    assert found["vessels"][0]["decision"] == "undecided"
    assert any(said in reason(one) for one in found["judging"]["features"])


def test_sides_of_a_tolerance_are_judged_apart_and_the_tighter_limit_counts() -> None:
    tolerances = Tolerances(VesselLimits(Limit(minus_percent=5, plus_percent=10)))
    wide, narrow = (vessel(n, np.full(20, e), u_um=5.0) for n, e in ((0, 40.0), (1, -40.0)))
    found = judge(registration(wide, narrow), tolerances)
    assert [row["decision"] for row in found["vessels"]] == ["pass", "fail"]
    assert found["findings"][0]["limit"] == "+10/\N{MINUS SIGN}5 %"
    limit = Limit(minus_percent=10, plus_percent=10, minus_um=20, plus_um=20)
    row = vessel(0, np.full(20, 40.0), u_um=5.0)
    found = judge(registration(row), Tolerances(VesselLimits(limit)))
    assert found["vessels"][0]["decision"] == "fail"


def test_a_later_override_counts_and_a_vessel_that_isnt_there_is_named() -> None:
    wide = Limit(minus_percent=30, plus_percent=30)
    by_kind = Override(frozenset(), frozenset({"channel"}), {"diameter": wide})
    by_number = Override(frozenset({1}), frozenset(), {"diameter": Limit(5, 5)})
    rows = [vessel(n, np.full(20, 60.0), u_um=5.0) for n in (0, 1)]
    found = judge(registration(*rows), Tolerances(overrides=(by_kind, by_number)))
    assert [row["decision"] for row in found["vessels"]] == ["pass", "fail"]
    for numbers, kinds, said in (
        ({7}, (), r"vessel 7 isn't in the network.*vessels 0 to 1"),
        ((), {"vein"}, "kind 'vein'"),
    ):
        override = Override(frozenset(numbers), frozenset(kinds), {})
        with pytest.raises(ToleranceError, match=said):
            judge(registration(*rows), Tolerances(overrides=(override,)))


def test_features_have_limits_of_their_own() -> None:
    limits = VesselLimits(
        mean=Limit(2, 2),
        narrowest=Limit(minus_um=15),
        offset_um=3.0,
        leak_um=300.0,
        rule=Rule(DecisionRule.GUARDED),
    )
    errors = np.full(30, 20.0)
    errors[10] = -20.0
    leak = change(0, 1.0, 1.2) | {"kind": "leak", "size_um": 200.0, "error_um": 20.0}
    row = vessel(0, errors, u_um=3.0, offset_interval_95_um=[0.5, 0.5])
    found = judge(registration(row, defects=[leak]), Tolerances(limits))
    decisions = {f["name"]: f["decision"] for f in found["judging"]["features"]}
    assert decisions == {
        "section": "undecided", "narrowest": "undecided", "mean": "fail", "offset": "fail",
        "open": "pass", "leak": "pass", "rms": "pass", "rigid": "pass",
    }  # fmt: skip


DENIED = {"kind": "stenosis", "size_um": -20.0, "error_um": 23.0, "percent": -4.0}


def test_a_change_that_its_own_interval_denies_isnt_listed() -> None:
    row = vessel(0, errors_within(-20.0), u_um=23.0)
    found = judged(row, defects=[change(0, 1.9, 2.4, **DENIED)])
    assert found["findings"] == found["defects"] == []
    assert judge_plain(found, 100.0, 10.0) == found


def test_judging_again_gives_the_same_and_a_wider_tolerance_clears() -> None:
    errors = noise(40, 3.0) + np.where(np.arange(40) >= 20, -105.0, 0.0)
    once = judged(vessel(0, errors, u_um=SURE), defects=[change(0, 0.2, 0.4)])
    assert judge_plain(once, 100.0, 10.0) == once
    wider = judge_plain(once, 100.0, 40.0)
    assert [d["decision"] for d in wider["findings"]] == ["pass"]


def test_closed_sections_are_their_occlusions_and_nothing_fails_on_an_unsure_axis() -> None:
    errors = np.zeros(40)
    errors[10:20] = -500.0
    plug = change(0, 1.22, 2.38) | {"kind": "occlusion", "size_um": 1160.0, "percent": None}
    row = vessel(0, errors, u_um=SURE, open=False)
    for k in range(10, 20):
        row["noise_um"][k] = row["interval_95_um"][k] = None
    found = judged(row, defects=[plug])
    assert [(d["kind"], d["decision"]) for d in found["findings"]] == [("occlusion", "fail")]
    assert set(found["vessels"][0]["decision_along"][10:20]) == {"fail"}
    leak = change(0, 1.3, 1.5) | {"kind": "leak", "size_um": 200.0, "percent": None}
    rows = vessel(0, errors, u_um=SURE, open=False), vessel(1, np.zeros(40), u_um=SURE)
    numbers = registration(*rows, defects=[plug, leak], perfusion={"vessels": []})
    withhold_unsure(numbers, [((1.1, 2.5),), ()])
    found = judge_plain(numbers | {"judging": GUARDED}, 100.0, 10.0)
    assert [row["decision"] for row in found["vessels"]] == ["undecided", "pass"]
    assert found["vessels"][0]["open"] is None
    assert [(d["kind"], d["decision"]) for d in found["findings"]] == [("leak", "undecided")]
    assert (found["all_open"], found["perfusion"]) == (False, None)


@settings(max_examples=examples(200), deadline=None)
@given(st.data())
def test_whatever_is_drawn_outside_its_limits_is_in_the_list(data: st.DataObject) -> None:
    rows, defects = [], []
    for number in range(data.draw(st.integers(1, 3))):
        n = data.draw(st.integers(1, 40))
        seed, step = data.draw(st.integers(0, 2**16)), data.draw(st.integers(0, 40))
        rng = np.random.default_rng(seed)
        errors = rng.normal(0, rng.uniform(0, 40), n) + rng.uniform(-150, 150) * (
            np.arange(n) >= step
        )
        errors = np.where(rng.random(n) < 0.1 * (seed % 2), -500.0, errors)
        row = vessel(number, errors, u_um=data.draw(st.sampled_from([0.5, 8.0, 60.0])))
        kept = rng.random(n) < 0.9
        for name in ("along_mm", "diameter_um", "noise_um", "designed_along_um", "place_mm",
                     "interval_95_um"):  # fmt: skip
            if name in row:
                row[name] = [value for value, keep in zip(row[name], kept, strict=True) if keep]
        rows.append(row)
        if data.draw(st.booleans()):
            low, high = sorted(rng.uniform(0, n * 0.12, 2))
            kind = str(rng.choice(["bulge", "stenosis", "occlusion"]))
            defects.append(change(number, low, high, kind=kind))
    found = judged(*rows, defects=defects)
    for row in found["vessels"]:
        drawn = zip(row["along_mm"], row["diameter_um"], row["lower_um"], row["upper_um"],
                    row["interval_95_um"], row["decision_along"], strict=True)  # fmt: skip
        for along, measured, lower, upper, half, decision in drawn:
            reach = 0.0 if measured == 0 else half
            outside = measured - reach < lower - 0.02 or measured + reach > upper + 0.02
            if outside:
                assert decision != "pass"
            listed = [
                d for d in found["findings"]
                if d["vessel"] == row["vessel"] and d["decision"] != "pass"
                and d["from_mm"] - 0.061 <= along <= d["to_mm"] + 0.061
            ]  # fmt: skip
            assert listed or decision == "pass"
    if any(d["decision"] == "fail" for d in found["findings"]):
        assert found["judging"]["decision"] == "fail"


@pytest.mark.slow
def test_a_vessel_at_its_limit_fails_in_fewer_than_one_of_a_hundred() -> None:
    failed, trials, n = 0, 2000, 40
    rng = np.random.default_rng(1)
    rows = []
    for number in range(trials):
        errors = -50.0 + rng.normal(0, 4.0) + rng.normal(0, 5.0, n)
        half = 1.96 * np.hypot(4.0, 5.0)
        rows.append(vessel(number, errors, noise_um=5.0, u_um=float(half)))
    found = judged(*rows)
    failed = sum(row["decision"] == "fail" for row in found["vessels"])
    assert failed <= 0.01 * trials


def errors_within(height: float) -> np.ndarray:
    return np.where((np.arange(40) > 15) & (np.arange(40) < 20), height, 0.0)


@pytest.mark.parametrize(
    ("errors", "changes", "decision"),
    [
        (np.full(40, 90.0), [(0.6, 1.0), (1.8, 2.2), (3.0, 3.4)], "fail"),
        (errors_within(80.0), [(1.7, 2.5)], "fail"),
        (errors_within(30.0), [(1.9, 2.4)], "pass"),
    ],
    ids=["found in pieces", "a run within", "within tolerance"],
)
def test_a_change_is_one_finding_and_within_tolerance_a_pass(errors, changes, decision) -> None:
    defects = [change(0, low, high) for low, high in changes]
    found = judged(vessel(0, errors, u_um=SURE), defects=defects)
    (finding,) = found["findings"]
    assert (finding["decision"], finding["local"]) == (decision, True)
    assert found["judging"]["decision"] == decision
    if len(changes) > 1:
        assert (finding["from_mm"], finding["to_mm"]) == (0, pytest.approx(4.8))


def test_limits_of_one_side_are_said_as_such() -> None:
    assert str(Limit(minus_um=30)) == "not below \N{MINUS SIGN}30 µm"
    assert str(Limit(plus_percent=5)) == "not above +5 %"


def test_what_fails_as_the_narrowest_is_a_fail_in_the_list_too() -> None:
    limits = VesselLimits(Limit(minus_percent=20, plus_percent=10), narrowest=Limit(minus_um=15))
    errors = np.zeros(30)
    errors[12:15] = -60.0
    found = judge(registration(vessel(0, errors, u_um=3.0)), Tolerances(limits))
    assert [one["decision"] for one in found["findings"]] == ["fail"]
    said = "+10/\N{MINUS SIGN}20 % and not below \N{MINUS SIGN}15 µm"
    assert found["findings"][0]["limit"] == said
    assert found["vessels"][0]["lower_um"][0] == 485.0
