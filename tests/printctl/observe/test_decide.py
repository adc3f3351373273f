"""Decisions by expected cost, and modes."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from printctl.inspection.values import Blob, Gap
from printctl.observe.deciding import (
    Costs,
    Decider,
    DecisionKind,
    FlowBlocks,
    InkSupply,
    Limits,
    SupplyState,
)
from printctl.observe.deciding.evidence import MapCheck, NarrowedLumen, ThinStretch, UnseenPath
from printctl.observe.observer import restore, state_of
from tests.printctl.observe.observer_bench import GAP, LOOK, Bench, decided, evidence, flow

GO_ON, PAUSE, MEND, FLOW = (
    DecisionKind.GO_ON,
    DecisionKind.PAUSE,
    DecisionKind.MEND,
    DecisionKind.FLOW,
)
LACKS = MapCheck("lacks 20 of 300 rows (400 µm) against the last look's")
CLOG = InkSupply(SupplyState.CLOGGED, 3.0)
TORN = "moved by +0.4 mm along x and +0.0 mm along y at one end against the other"
THIN = (ThinStretch(3, 0.0, 7.0, 0.3),)
LONG = replace(GAP, to_mm=40.0)


def unseen(name, low, high, whole):
    gap = Gap(7, low, high, (low, 2.0), (high, 2.0), 0.0, 1.0)
    return UnseenPath(name, gap, whole)


WHOLE = unseen("vessel 2", 0.0, 6.6, 6.6)
PART = unseen("vessel 3", 1.0, 3.5, 5.0)
SHORT = unseen("vessel 2", 1.0, 1.6, 9.0)
BLOBS = tuple(
    Blob("blob", (10.0 + k, 20.0), np.zeros((4, 2)), 0.2 + 0.1 * k, True, 1e-6, 0.21)
    for k in range(4)
)
CASES = [
    # what was and wasn't seen
    ({}, GO_ON, None, "as expected, within tolerance"),
    ({"seen_share": 0.25, "unseen": (SHORT,)}, GO_ON, None, "of the 25% that was seen: as"),
    ({"seen_share": 0.0006, "level_mm": 0.1, "way_mm": 20.0}, GO_ON, None, "nothing was seen"),
    ({"unseen": (WHOLE,), "seen_share": 0.0}, PAUSE, MEND, "no picture shows vessel 2 (6.6 mm)"),
    ({"unseen": (WHOLE,), "seen_share": 0.0, "mode": "tell"}, GO_ON, None, "vessel 2"),
    ({"unseen": (PART,), "seen_share": 0.5}, PAUSE, MEND, "2.5 of 5.0 mm of vessel 3"),
    # gaps
    ({"gaps": (GAP,)}, MEND, None, "1 gap, 1.00 mm in all (X 0.0 Y 0.0 to X 1.0 Y 0.0, 1.00 mm)"),
    ({"gaps": (GAP,), "mode": "ask"}, PAUSE, MEND, ""),
    ({"gaps": (GAP,), "mode": "tell"}, GO_ON, None, "only reported"),
    ({"gaps": (GAP,), "second_gaps": ()}, GO_ON, None, "in one of two pictures alone"),
    ({"gaps": (LONG,)}, PAUSE, MEND, "40% of what was written would be missing"),
    ({"gaps": (LONG,), "way_mm": 4000.0}, MEND, None, ""),
    (
        {"gaps": (replace(GAP, to_mm=30.0),), "single_picture_reason": "hangs", "way_mm": 4e3},
        PAUSE,
        MEND,
        "hangs",
    ),
    ({"gaps": (GAP,), "single_picture_reason": "hangs"}, MEND, None, "by one picture"),
    # lumens and place
    ({"narrowed": (NarrowedLumen("5", 0.0, 0.02),)}, PAUSE, None, "lumen 5 is closed"),
    ({"narrowed": (NarrowedLumen("5", 0.85, 0.05),)}, GO_ON, None, ""),
    (
        {"narrowed": (NarrowedLumen("5", 0.4, 0.02),), "gaps": (GAP,), "second_gaps": (GAP,)},
        PAUSE,
        MEND,
        "",
    ),
    ({"shift_mm": 0.3, "u_shift_mm": 0.02}, PAUSE, None, "0.30 mm beside its place"),
    ({"shift_mm": 0.2, "u_shift_mm": 0.1}, GO_ON, None, ""),
    ({"turned": "turned by 180°", "gaps": (GAP,)}, PAUSE, None, "turned by 180°"),
    ({"turned": TORN, "gaps": (GAP,)}, PAUSE, None, "the map lacks rows or columns"),
    # maps of heights
    ({"map": LACKS}, GO_ON, None, "the map lacks 20 of 300 rows"),
    ({"map": LACKS, "gaps": (replace(GAP, to_mm=3.0),)}, PAUSE, MEND, "lacks 20 of 300 rows"),
    ({"map": LACKS, "supply": CLOG, "gaps": (GAP,)}, PAUSE, MEND, "the map lacks 20 of 300"),
    ({"map": MapCheck(sunk_mm=0.12)}, GO_ON, None, "sunk by up to 120 µm"),
    ({"blobs": BLOBS}, GO_ON, None, "4 blobs stand on the layer (X 13.0 Y 20.0, 0.80 mm wide, 210"),
    # amounts
    ({"flow": flow(0.8), "mode": "ask"}, PAUSE, FLOW, ""),
    ({"flow": flow(0.8), "mode": "tell"}, GO_ON, None, ""),
    ({"flow": flow(0.2, 300)}, PAUSE, None, "beyond a correction"),
    ({"thin": THIN, "mode": "ask"}, PAUSE, MEND, "7.00 mm of thin lines"),
    ({"seem_thin": THIN}, GO_ON, None, ""),
    ({"seem_thin": THIN, "flow": flow(1.3)}, FLOW, None, ""),
]


@pytest.mark.parametrize(("changed", "kind", "ask", "words"), CASES)
def test_one_look_is_decided_by_its_evidence(changed, kind, ask, words):
    found = decided(**changed)
    assert (found.kind, found.ask) == (kind, ask)
    assert words in found.why


@pytest.mark.parametrize(
    ("changed", "gaps", "thin", "factor"),
    [
        ({"flow": flow(0.8)}, (), (), 1.25),
        ({"gaps": (GAP,), "flow": flow(0.8)}, (GAP,), (), 1.25),
        ({"thin": THIN, "flow": flow(0.7)}, (), THIN, 1.43),
        ({"seem_thin": THIN, "flow": flow(0.7)}, (), THIN, 1.43),
        ({"supply": CLOG, "gaps": (GAP,)}, (GAP,), (), None),
        ({"unseen": (WHOLE,), "seen_share": 0.0, "gaps": (GAP,)}, (WHOLE.gap, GAP), (), None),
        ({"unseen": (PART,), "seen_share": 0.5}, (PART.gap,), (), None),
        ({"gaps": (GAP,), "turned": "turned by 180°", "flow": flow(0.8)}, (), (), None),
        ({"gaps": (GAP,), "second_gaps": ()}, (), (), None),
    ],
)
def test_a_decision_has_what_is_written_again_and_the_flow(changed, gaps, thin, factor):
    found = decided(**changed)
    assert (found.gaps, found.thin) == (gaps, thin)
    assert found.factor == (None if factor is None else pytest.approx(factor, abs=0.03))


@pytest.mark.parametrize(
    ("costs", "kind"),
    [
        (Costs(), MEND),
        (Costs(missed_ink_mm=0.0), GO_ON),
        (Costs(operator=1e-9), PAUSE),
        (Costs(false_ink_mm=1e6), GO_ON),
    ],
)
def test_what_a_recipe_says_of_costs_decides(costs, kind):
    """Ink that costs nothing isn't mended; an operator who costs nothing is always asked."""
    assert Decider(Limits(mend="mend", costs=costs)).decide(evidence(gaps=(GAP,))).kind is kind


@pytest.mark.parametrize("chance", [1e-9, 1e-4, 1e-2, 0.3])
def test_a_gap_is_mended_only_where_that_costs_least(chance):
    """The costs of all three, counted here anew from the gap's own chance of being none."""
    long = 2.0
    gap = replace(GAP, to_mm=long, p_value=chance / 400)
    found = Decider(Limits(mend="mend")).decide(evidence(gaps=(gap,)))
    believed = chance <= Limits().gap.rate
    elsewhere = 1e-3 / (1e-3 + math.exp(-long / 100.0 / 0.1))
    costs = {GO_ON: 5.0 * long, MEND: 20.0 * long * (chance + elsewhere), PAUSE: 10.0}
    assert found.kind is (min(costs, key=costs.get) if believed else GO_ON)


def test_what_is_remembered_of_a_mend_that_failed_can_be_saved():
    """Ends of a gap in a mend were NumPy's: the look's record wasn't written."""
    decider = Decider(Limits(mend="mend"))
    gap = replace(GAP, from_mm=np.float64(0.0), to_mm=np.float64(3.0))
    assert decider.decide(evidence(gaps=(gap,))).kind is MEND
    assert json.loads(json.dumps(state_of(decider)))["failed"] is True


def test_a_shift_that_grows_stops():
    decider = Decider(Limits(mend="mend"))
    assert decider.decide(evidence(shift_mm=0.3, u_shift_mm=0.02)).kind is PAUSE
    assert decider.decide(evidence(shift_mm=0.6, u_shift_mm=0.02)).kind is DecisionKind.STOP


def test_a_flow_beyond_all_bounds_pauses_where_a_look_tells_it():
    """A clog in part that was over paused at each look that told no width; once is enough."""
    decider = Decider(Limits(mend="mend"))
    found = [
        decider.decide(evidence(flow=flow(*each))) for each in ((0.3,), (1, 0), (1, 0), (0.3,))
    ]
    assert [one.kind for one in found] == [PAUSE, PAUSE, GO_ON, PAUSE]
    assert "tells no width" in found[1].why


@pytest.mark.parametrize(("apart", "joins"), [(0.1, True), (0.5, False)])
def test_approving_a_gap_takes_along_what_joins_it_and_is_not_seen(apart: float, joins: bool):
    begin = GAP.to_mm + apart
    rest = replace(GAP, from_mm=begin, to_mm=begin + 1.0)
    beside = {"unseen": (UnseenPath("path 2", rest, 9.0),), "level_mm": 0.2}
    assert decided("ask", gaps=(GAP,), **beside).gaps == ((GAP, rest) if joins else (GAP,))
    found = decided("mend", gaps=(GAP,), **beside)
    assert found.gaps == (GAP,)  # unasked the gap alone
    assert "1.0 of 9.0 mm of path 2" in found.why


# --- way that wasn't seen, look by look
def blind(way_mm, stroke=7, **changed):
    """A look of which nothing is told."""
    gap = Gap(stroke, 0.0, way_mm, (98.0, 101.0), (98.0 + way_mm, 101.0), 0.1, 1.0)
    given = {"seen_share": 0.0, "way_mm": way_mm, "level_mm": 0.2}
    return evidence(**{**given, "unseen": (UnseenPath("path 7", gap, way_mm),), **changed})


@pytest.mark.parametrize(("failed", "looks"), [(False, 8), (True, 3)])
def test_a_blind_observer_asks_once_sooner_where_ink_has_failed(failed, looks):
    """What a clog loses grows with the square of the way that nobody sees."""
    decider = Decider(Limits(mend="mend"))
    seen = {"level_mm": 0.1, "coverage": 1.0}
    decider.decide(evidence(gaps=(replace(GAP, to_mm=6.0),) * failed, **seen))
    found = [decider.decide(blind(18.0, stroke=k)) for k in range(20)]
    assert [k + 1 for k, one in enumerate(found) if one.kind is PAUSE] == [looks]
    asked = found[looks - 1]
    assert asked.ask is None
    assert "nothing tells whether ink lies on the last" in asked.why
    assert "a laser line or an OCT" in asked.why


def test_ink_that_is_seen_again_ends_the_count():
    decider = Decider(Limits(mend="mend"))
    for _ in range(20):
        decider.decide(evidence(level_mm=0.1, coverage=1.0, seen_share=0.6, way_mm=20.0))
        assert decider.decide(blind(18.0)).kind is GO_ON


def test_what_looks_left_unseen_is_kept_for_another_observer():
    decider, other = Decider(Limits()), Decider(Limits())
    decider.decide(blind(8.0))
    restore(other, json.loads(json.dumps(state_of(decider))))
    assert [one.stroke for one in other.unseen] == [7]
    assert other.unseen_mm == 8.0


def test_a_clog_that_is_seen_takes_along_what_the_look_before_left_unseen():
    decider = Decider(Limits(mend="mend"))
    decider.decide(blind(8.0, stroke=1))
    found = decider.decide(evidence(gaps=(GAP,), supply=CLOG, level_mm=0.1, coverage=0.0))
    assert (found.kind, found.ask) == (PAUSE, MEND)
    assert [one.stroke for one in found.gaps] == [1, 2]


# --- a flow that is likely off, though widths don't tell it surely, is asked about
def look(ratio, common, factor=1.0):
    """A picture of lines with so much of the ink asked for, of all known alike to ``common``."""
    full, time = np.full(5, ratio), np.arange(5.0)
    return evidence(flow=FlowBlocks(time, full, np.hypot(common, 0.02) * full, 0 * full + factor,
                                    common))  # fmt: skip


@pytest.mark.parametrize(
    ("ratio", "common", "asked"),
    [(0.57, 0.22, True), (0.7, 0.12, True), (1.3, 0.12, True), (0.9, 0.05, False),
     (0.9, 0.12, False), (0.7, 0.4, False)],
)  # fmt: skip
def test_a_print_that_begins_with_another_flow_is_asked_about(ratio, common, asked):
    """White ink that flowed at 70 % from its first millimetre on was "as expected"."""
    decider = Decider(Limits(mend="mend"))
    found = decider.decide(look(ratio, common))
    assert (found.ask is DecisionKind.FLOW) is asked
    if asked:
        assert found.factor == pytest.approx(1 / ratio, abs=0.06)
        assert f"{ratio:.0%} ±" in found.why
        assert decider.decide(look(ratio, common)).kind is DecisionKind.GO_ON  # asked once
    assert Decider(Limits(mend="tell")).decide(look(ratio, common)).kind is DecisionKind.GO_ON


# --- corrections of the flow that the amount of ink seen doesn't answer are taken back
NOISE = 0.03


def looked(rng, seconds, ratios, factor, common=0.05):
    """One look's readings: amounts seen over asked for, a second each."""
    ratios = np.asarray(ratios) * (1 + NOISE * rng.standard_normal(len(ratios)))
    u = np.full(len(ratios), math.hypot(NOISE, common))
    return FlowBlocks(
        seconds + np.arange(len(ratios), dtype=float), ratios, u * ratios,
        np.full(len(ratios), factor), common,
    )  # fmt: skip


def printed(seed, seen, looks=8, count=6):
    """Decisions of looks; ``seen(second, factor)`` is the amount over the one asked for."""
    rng, decider, decisions = np.random.default_rng(seed), Decider(Limits(mend="mend")), []
    for k in range(looks):
        factor = decider.control.factor
        ratios = [seen(count * k + second, factor) for second in range(count)]
        flow = looked(rng, float(count * k), ratios, factor)
        decisions.append(decider.decide(evidence(flow=flow)))
        if decisions[-1].factor is not None:
            decider.control.put_in_force(decisions[-1].factor)
    return decider, decisions


@pytest.mark.parametrize("seed", range(10))
def test_amounts_that_answer_no_correction_are_corrected_no_more(seed):
    """A halo made sound ink look 129 % wide; corrections went on to 0.6 (20 mm of false fill)."""
    decider, decisions = printed(seed, lambda second, factor: 1.35 * factor**0.1)
    pauses = [one for one in decisions if one.kind is DecisionKind.PAUSE]
    assert decider.control.factor == 1.0
    assert len(pauses) == 1
    assert "hardly changed" in pauses[0].why
    assert pauses[0].factor == 1.0
    assert sum(one.kind is DecisionKind.FLOW for one in decisions) <= 2


@pytest.mark.parametrize("seed", range(10))
def test_a_flow_that_falls_for_long_is_answered(seed):
    """Each look sees what the flow lost since the last correction: no sign of no answer."""
    decider, decisions = printed(
        seed, lambda second, factor: factor * math.exp(-0.015 * max(0, second - 10)), looks=6
    )
    assert not decider.control.answers.failed  # a question about the flow, as it falls, is none
    assert all(one.factor for one in decisions if one.kind is DecisionKind.PAUSE)
    assert decider.control.factor > 1.2


def test_the_correction_is_taken_back_before_the_print_is_paused(tmp_path):
    bench = Bench(tmp_path)
    control = bench.observer.decider.control
    control.answers.failed = True
    bench.observer.judge = judged_at(bench.observer.judge, 0.7)
    record = bench.observer.look(LOOK)
    assert [one[0] for one in bench.link.said] == ["insert", "pause"]
    assert bench.link.said[0][3] == 1.0
    assert (record.decision, record.factor) == ("pause", 1.0)


def judged_at(judge, flow):
    return lambda *said: replace(judge(*said), flow=flow)
