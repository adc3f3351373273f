"""Decisions by their rules and modes."""

import json
import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from printctl.observe.deciding import (
    Decider,
    DecisionKind,
    FlowBlocks,
    InkSupply,
    Limits,
    SupplyState,
)
from printctl.observe.deciding.evidence import MapCheck, Narrowed, Thin, UnseenPath
from printctl.observe.observer import restore, state_of
from registration.inspection.findings import ToldOfInk
from registration.inspection.values import Blob, Gap
from tests.printctl.observe.observer_bench import GAP, LOOK, Bench, decided, evidence, flow

GO_ON, PAUSE, MEND, FLOW = (
    DecisionKind.GO_ON,
    DecisionKind.PAUSE,
    DecisionKind.MEND,
    DecisionKind.FLOW,
)
NOTHING = {"seen_share": 0.0, "coverage": math.nan, "level_mm": 0.2, "flow": flow(1.0, 0)}
LACKS = MapCheck("lacks 20 of 300 rows (400 µm) against the last look's")
CLOG = InkSupply(SupplyState.CLOGGED, 1.0, 3.0, 0)
TORN = "moved by +0.4 mm along x and +0.0 mm along y at one end against the other"
THIN = (Thin(3, 0.0, 7.0, 0.3),)
SHORT = replace(GAP, to_mm=0.07, u_tip_mm=0.1)  # within tolerance, as far as is known


def unseen(name, low, high, whole, **more):
    gap = Gap(7, low, high, (low, 2.0), (high, 2.0), 0.0, 1.0)
    return UnseenPath(name, gap, whole, **more)


WHOLE = unseen("vessel 2", 0.0, 6.6, 6.6, bare=True)
PART = unseen("vessel 3", 1.0, 3.5, 5.0)
HIDDEN = tuple(
    unseen("vessel 2", at, at + long, 9.0)
    for at, long in ((0.0, 0.3), (1.0, 1.4), (3.0, 0.5), (5.0, 0.4))
)
BLOBS = tuple(
    Blob("blob", (10.0 + k, 20.0), np.zeros((4, 2)), 0.2 + 0.1 * k, True, 1e-6, 0.21)
    for k in range(4)
)
LOW = Gap(3, 2.0, 9.0, (100.0, 101.0), (107.0, 101.0), 0.0, 1.0)
CASES = [
    # what was and wasn't seen
    ({}, GO_ON, None, "as expected"),
    ({"seen_share": 0.25}, GO_ON, None, "only 25% was seen"),
    ({"seen_share": 0.25, "over_old_share": 0.6}, GO_ON, None, "as expected"),
    ({"seen_share": 0.0006}, GO_ON, None, "nothing was seen"),
    ({"seen_share": 0.74, "way_mm": 4.6}, GO_ON, None, "1.2 of 4.6 mm weren't seen"),
    ({"seen_share": 0.5, "over_old_share": 0.4, "way_mm": 5.0}, GO_ON, None, "0.5 of 5.0 mm"),
    (
        {"seen_share": 0.7, "way_mm": 9.0, "hidden": HIDDEN},
        GO_ON,
        None,
        "1.4 of 9.0 mm of vessel 2",
    ),
    ({**NOTHING, "faint_share": 0.1}, PAUSE, None, "no ink is seen yet"),
    ({**NOTHING, "faint_share": 0.9}, GO_ON, None, "longer ones alone are told"),
    ({"unseen": (WHOLE,), "seen_share": 0.0}, PAUSE, MEND, "nothing is seen of vessel 2 (6.6 mm)"),
    ({"unseen": (WHOLE,), "seen_share": 0.0, "mode": "tell"}, GO_ON, None, "vessel 2"),
    ({"unseen": (PART,), "seen_share": 0.5}, PAUSE, MEND, "2.5 of 5.0 mm of vessel 3"),
    ({"unseen": (PART,), "seen_share": 0.5, "mode": "tell"}, GO_ON, None, "2.5 of 5.0 mm"),
    ({"coverage": 0.003, "seen_share": 0.2, "over_old_share": 0.3}, PAUSE, None, "on 0% of what"),
    ({"coverage": 0.003, "seen_share": 0.2, "gaps": (GAP,)}, PAUSE, MEND, ""),
    ({"coverage": 0.33}, PAUSE, None, "ink lies on 33%"),
    ({"coverage": 0.34}, GO_ON, None, ""),
    ({"coverage": 0.0, "way_mm": 0.9}, GO_ON, None, ""),
    ({"coverage": math.nan}, GO_ON, None, ""),
    # gaps
    ({"gaps": (GAP,)}, MEND, None, ""),
    ({"gaps": (GAP,), "mode": "ask"}, PAUSE, MEND, ""),
    ({"gaps": (GAP,), "mode": "tell"}, GO_ON, None, ""),
    ({"gaps": (GAP,), "second": ()}, GO_ON, None, "in one of two pictures alone"),
    ({"gaps": (GAP,), "second": (), "half_seen": (GAP,)}, PAUSE, MEND, ""),
    ({"gaps": (SHORT,), "second": (), "half_seen": (SHORT,)}, GO_ON, None, ""),
    ({"gaps": (replace(GAP, shaded=True),)}, PAUSE, MEND, ""),
    ({"gaps": (GAP,), "way_mm": 2.5}, PAUSE, MEND, "40% of what was written"),
    ({"gaps": (GAP,), "seen_share": 0.2}, PAUSE, MEND, "only 20% was seen"),
    ({"gaps": (GAP,), "seen_share": 0.2, "over_old_share": 0.7}, MEND, None, ""),
    ({"gaps": (GAP,), "beside_mm": 2.0}, PAUSE, MEND, "2.0 mm of a line lie where none should"),
    ({"gaps": (GAP,), "beside_mm": 0.3}, MEND, None, ""),
    ({"beside_mm": 2.0}, GO_ON, None, ""),
    (
        {"unplaced": (GAP,), "shift_mm": 0.05, "u_shift_mm": 0.07},
        PAUSE,
        None,
        "nothing tells which",
    ),
    ({"narrowed": (Narrowed("5", 0.0, 0.02),)}, PAUSE, None, ""),
    ({"narrowed": (Narrowed("5", 0.85, 0.05),)}, GO_ON, None, ""),
    ({"narrowed": (Narrowed("5", 0.4, 0.02),), "gaps": (GAP,), "second": (GAP,)}, PAUSE, MEND, ""),
    # place
    ({"shift_mm": 0.3, "u_shift_mm": 0.02}, PAUSE, None, "0.30 mm beside its place"),
    ({"shift_mm": 0.3, "u_shift_mm": 0.1}, GO_ON, None, ""),
    ({"shift_mm": 0.3, "u_shift_mm": 0.29, "aside": True}, PAUSE, None, "0.30 mm beside its place"),
    ({"turned": "turned by 180°", "gaps": (GAP,)}, PAUSE, None, "turned by 180°"),
    ({"turned": TORN, "gaps": (GAP,)}, PAUSE, None, "the map lacks rows or columns"),
    # maps of heights
    ({"map": LACKS}, GO_ON, None, "the map lacks 20 of 300 rows"),
    ({"map": LACKS, "gaps": (GAP,), "flow": flow(0.8)}, PAUSE, MEND, "lacks 20 of 300 rows"),
    ({"map": LACKS, "shift_mm": 0.4, "u_shift_mm": 0.01}, PAUSE, None, "the map lacks 20 of 300"),
    ({"map": LACKS, "supply": CLOG, "gaps": (GAP,)}, PAUSE, MEND, "the map lacks 20 of 300"),
    ({"map": MapCheck(unsized=True), "gaps": (GAP,)}, PAUSE, MEND, "whether the map is whole"),
    ({"map": MapCheck(unsized=True)}, GO_ON, None, ""),
    ({"map": MapCheck(sunk_mm=0.12)}, GO_ON, None, "sunk by up to 120 µm"),
    ({"blobs": BLOBS}, GO_ON, None, "4 blobs stand on the layer (X 13.0 Y 20.0, 0.80 mm wide, 210"),
    ({"least_gap_mm": 0.35}, GO_ON, None, "shorter than 0.35 mm may not show"),
    ({"by_height_share": 0.8, "waver": 0.06}, GO_ON, None, "wavers there by 6% of a layer"),
    ({"by_height_share": 0.8, "waver": 0.17}, GO_ON, None, "more than the 15 %"),
    ({"by_height_share": 0.8, "waver": 0.03, "low": (LOW,)}, GO_ON, None, "along 7.0 mm it stands"),
    ({"untold_seams": 0.56}, GO_ON, None, "on 56% lines touch"),
    # amounts
    ({"flow": flow(0.8), "mode": "ask"}, PAUSE, FLOW, ""),
    ({"flow": flow(0.8), "mode": "tell"}, GO_ON, None, ""),
    ({"flow": flow(0.2, 300)}, PAUSE, None, ""),
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
        ({"unseen": (WHOLE,), "seen_share": 0.0, "gaps": (GAP,)}, (GAP, WHOLE.gap), (), None),
        ({"unseen": (PART,), "seen_share": 0.5}, (PART.gap,), (), None),
        ({"gaps": (GAP,), "turned": "turned by 180°", "flow": flow(0.8)}, (), (), None),
        ({"gaps": (GAP,), "second": ()}, (), (), None),
    ],
)
def test_a_decision_has_what_is_written_again_and_the_flow(changed, gaps, thin, factor):
    found = decided(**changed)
    assert (found.gaps, found.thin) == (gaps, thin)
    assert found.factor == (None if factor is None else pytest.approx(factor, abs=0.03))


def test_what_is_remembered_of_a_mend_that_failed_can_be_saved():
    """Ends of a gap in a mend were NumPy's: the look's record wasn't written."""
    decider = Decider(Limits(mend="mend"))
    gap = replace(GAP, from_mm=np.float64(0.0), to_mm=np.float64(3.0))
    assert decider.decide(evidence(gaps=(gap,))).kind is MEND
    assert json.loads(json.dumps(asdict(decider.layers)))["failed"] is True


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


@pytest.mark.parametrize(("apart", "asked"), [(0.1, True), (0.5, False)])
def test_what_cannot_be_told_next_to_a_gap_is_asked_about(apart: float, asked: bool):
    """Of 2 mm bare that ran into a crossing 0.5 mm were mended, without a word on the rest."""
    begin = GAP.to_mm + apart
    rest = replace(GAP, from_mm=begin, to_mm=begin + 1.0)
    found = decided(gaps=(GAP,), hidden=(UnseenPath("vessel 2", rest, 9.0),))
    assert (found.kind, found.gaps) == ((PAUSE, (GAP, rest)) if asked else (MEND, (GAP,)))
    assert ("1.0 of 9.0 mm of vessel 2" in found.why) or not asked


# --- decisions by how much earlier looks saw, and what nothing told of
def test_after_a_clog_a_layer_that_cannot_be_told_is_asked_about_once():
    clog = replace(GAP, to_mm=6.0)
    hidden = {"seen_share": 0.0, "over_old_share": 0.97}
    for mode, gap, kind in (
        ("mend", clog, DecisionKind.PAUSE),
        ("mend", GAP, DecisionKind.GO_ON),
        ("tell", clog, DecisionKind.GO_ON),
    ):
        decider = Decider(Limits(mend=mode))
        decider.decide(evidence(gaps=(gap,), level_mm=0.1))
        seen = decider.decide(evidence(level_mm=0.2))
        first, second = (decider.decide(evidence(level_mm=z, **hidden)) for z in (0.3, 0.4))
        assert seen.kind is DecisionKind.GO_ON
        assert (first.kind, second.kind) == (kind, DecisionKind.GO_ON)
        assert ("another clog would go unseen" in first.why) == (gap is clog)


@pytest.mark.parametrize(
    ("steps", "shows", "paused"),
    [
        ((0.2, 0.0004, 0.0004), True, True),
        ((0.2, 0.1, 0.03, 0.004, 0.002), True, False),
        ((0.01, 0.0004), True, False),
        ((0.11, 0.05, 0.11, 0.003), False, False),  # sound: sides of ridges changed, nothing more
    ],
)
def test_a_layer_over_older_ink_of_which_nothing_changes_pauses_once(steps, shows, paused):
    """A clog for good went unseen for five layers, each told as not to be told from older ink."""
    decider = Decider(Limits(mend="mend"))
    older = {"seen_share": 0.0, "over_old_share": 1.0, "older_mm": 12.0}
    shown = {**older, "faint_share": 1.0}
    decider.decide(evidence(**(shown if shows else older), level_mm=0.1, older_step=steps[0]))
    found = [decider.decide(evidence(**older, level_mm=0.2, older_step=one)) for one in steps[1:]]
    pauses = [one for one in found if one.kind is DecisionKind.PAUSE]
    assert len(pauses) == paused
    assert all("nothing has changed along the last 12 mm" in one.why for one in pauses)


def stretch(stroke, length_mm):
    return Gap(stroke, 0.0, length_mm, (98.0, 101.0), (98.0 + length_mm, 101.0), 0.1, 1.0)


def untold(way_mm, stroke=7, **changed):
    """A look of which nothing is told, over older ink."""
    tail = (stretch(stroke, way_mm),)
    told = ToldOfInk(head_mm=way_mm, untold=tail, tail=tail)
    older = {"seen_share": 0.0, "over_old_share": 1.0, "older_mm": way_mm, "way_mm": way_mm}
    return evidence(**{**older, "told": told, "level_mm": 0.2, **changed})


def test_an_observer_that_is_blind_says_so_once_and_names_the_stretch():
    """100 mm were missing over older ink on which fresh ink never showed, without a word."""
    decider = Decider(Limits(mend="mend"))
    found = [decider.decide(untold(8.0, stroke=k, older_step=0.001)) for k in range(12)]
    paused = [k for k, one in enumerate(found) if one.kind is DecisionKind.PAUSE]
    assert paused == [2]
    assert "nothing tells whether ink lies on the last 24 mm (X 98.0 Y 101.0 to" in found[2].why


def test_a_clog_over_ink_that_never_was_seen_there_is_asked_about_with_what_was_left_untold():
    """The look before had left the clog's first 3 mm untold; they were lost to the mend."""
    decider = Decider(Limits(mend="mend"))
    tail = (stretch(3, 3.0),)
    begun = ToldOfInk(came_mm=9.0, ink_mm=9.0, untold=tail, tail=tail)
    limit = {"older_limit": 0.0005}
    assert (
        decider.decide(untold(12.0, told=begun, older_step=0.05, **limit)).kind
        is DecisionKind.GO_ON
    )
    found = decider.decide(untold(12.0, older_step=0.0004, **limit))
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert [one.stroke for one in found.gaps] == [3, 7]
    assert "15.0 mm)" in found.why


def test_a_clog_that_is_seen_names_what_the_look_before_left_untold():
    decider = Decider(Limits(mend="mend"))
    tail = (stretch(1, 3.0),)
    decider.decide(evidence(told=ToldOfInk(ink_mm=9.0, tail=tail), level_mm=0.1))
    clogged = InkSupply(SupplyState.CLOGGED, 0.2, 0.2, 1)
    bare = ToldOfInk(head_mm=1.0, tail=(stretch(3, 8.0),))
    found = decider.decide(evidence(gaps=(GAP,), supply=clogged, told=bare, level_mm=0.1))
    assert [one.stroke for one in found.gaps] == [1, 2, 3]
    assert "with what the look before left untold (X 98.0 Y 101.0 to X 101.0 Y 101.0" in found.why


THIN_LAYERS_SEEN = ToldOfInk(came_mm=90.0, ink_mm=90.0, thin=(stretch(4, 6.0),))
STILL = ToldOfInk(came_mm=90.0, ink_mm=90.0, still=(stretch(4, 3.0), stretch(5, 1.0)))
DOUBTED = ToldOfInk(ink_mm=90.0, doubted=(stretch(4, 2.2), stretch(5, 1.0)))
BARE = {"coverage": math.nan, "level_mm": 0.1}
TAIL = (stretch(0, 6.0), stretch(1, 4.0))


@pytest.mark.parametrize(
    ("told", "more", "strokes", "words"),
    [
        # What did not change beside what did.
        (STILL, {"seen_share": 0.0}, [4], "nothing has changed along 3.0 mm"),
        # A stretch that looks bare though the picture changed.
        (DOUBTED, {}, [4], "2.2 mm (X 98.0 Y 101.0 to X 100.2 Y 101.0, 2.2 mm) look bare"),
        # A needle clogged from the start paused, proposed nothing, and 82 mm stayed bare.
        (
            ToldOfInk(head_mm=10.0, untold=TAIL, tail=TAIL),
            {**BARE, "seen_share": 0.0},
            [0, 1],
            "no ink is seen yet",
        ),
    ],
)
def test_ink_that_may_be_missing_is_asked_about(told, more, strokes, words):
    found = decided(**{"told": told, "level_mm": 0.2, **more})
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert [one.stroke for one in found.gaps] == strokes
    assert words in found.why


def test_ink_that_may_be_thin_is_asked_about_and_half_of_it_written_again():
    """Clogs in part over older ink went on as "the picture changed as by fresh ink"."""
    for mode in ("mend", "ask"):
        found = decided(mode, told=THIN_LAYERS_SEEN, level_mm=0.2)
        assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
        assert [(one.stroke, one.length_mm, one.missing) for one in found.thin] == [(4, 6.0, 0.5)]
        assert "along 6.0 mm (X 98.0 Y 101.0 to X 104.0 Y 101.0, 6.0 mm)" in found.why
        assert "ink may be thin there" in found.why


def test_approving_a_gap_takes_along_what_joins_it_and_is_not_seen():
    """5.4 mm beside an approved gap of 2.7 mm stayed bare: the shade of a wall's other line."""
    shaded = replace(GAP, to_mm=2.7, shaded=True)
    beside, far, long = (
        replace(GAP, from_mm=a, to_mm=b) for a, b in ((2.8, 8.2), (9, 12), (3, 40))
    )
    unseen = ToldOfInk(ink_mm=60.0, unseen=(beside, far))
    found = decided(gaps=(shaded,), told=unseen, level_mm=0.2)
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert found.gaps == (shaded, beside)
    assert "approve also writes 5.4 mm beside it that isn't told" in found.why
    longer = decided(gaps=(shaded,), told=ToldOfInk(ink_mm=60.0, unseen=(long,)), level_mm=0.2)
    assert longer.gaps == (shaded,)
    assert decided(gaps=(GAP,), told=unseen, level_mm=0.2).gaps == (GAP,)  # mended unasked


def test_what_looks_left_untold_is_kept_for_another_observer():
    decider, other = Decider(Limits()), Decider(Limits())
    decider.decide(untold(8.0, older_step=0.001))
    restore(other, json.loads(json.dumps(state_of(decider))))
    assert [one.stroke for one in other.layers.tail] == [7]
    assert other.layers.tail[0].length_mm == 8.0


def test_a_print_of_which_no_ink_is_seen_pauses_at_its_first_look_and_once():
    """A needle that was clogged from the first line on wrote two layers of nothing before."""
    decider = Decider(Limits(mend="mend"))
    nothing = {"seen_share": 0.0, "way_mm": 4.0, "level_mm": 0.1}
    kinds = [decider.decide(evidence(**nothing)).kind for _ in range(3)]
    assert kinds == [DecisionKind.GO_ON, DecisionKind.PAUSE, DecisionKind.GO_ON]


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
    assert "isn't corrected" in decisions[-1].why
    assert sum(one.kind is DecisionKind.FLOW for one in decisions) <= 2


@pytest.mark.parametrize("seed", range(10))
def test_a_flow_that_falls_for_long_is_answered(seed):
    """Each look sees what the flow lost since the last correction: no sign of no answer."""
    decider, decisions = printed(
        seed, lambda second, factor: factor * math.exp(-0.015 * max(0, second - 10)), looks=6
    )
    assert not [one for one in decisions if one.kind is DecisionKind.PAUSE]
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
