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
from printctl.observe.deciding.evidence import Narrowed, UnseenPath
from printctl.observe.deciding.thin import Thin
from printctl.observe.map_check import MapCheck
from registration.inspection.values import Blob, Gap
from tests.printctl.observe.decisions import GAP, decided, evidence, flow

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
    ({"coverage": 0.69}, GO_ON, None, ""),
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


def test_what_readings_share_is_never_known_better():
    blocks = FlowBlocks(np.zeros(50), np.full(50, 0.96), np.full(50, 0.03), np.ones(50), 0.03)
    assert decided(flow=blocks).kind is GO_ON


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
