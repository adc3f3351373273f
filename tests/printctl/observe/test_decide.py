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
from registration.inspection.values import Blob, Gap
from tests.printctl.observe.decisions import GAP, decided, evidence, flow


def test_a_sound_layer_goes_on():
    assert decided().kind is DecisionKind.GO_ON


def test_a_layer_of_which_little_was_seen_is_not_called_sound():
    assert (
        decided(seen_share=0.25).why == "only 25% was seen; that is as expected, within tolerance"
    )
    assert decided(seen_share=0.25, over_old_share=0.6).why.startswith("as expected")


def test_a_look_that_goes_on_says_how_much_was_not_seen():
    """1.2 mm were missing at a vessel's start, of which 74 % were seen: "as expected" alone."""
    said = decided(seen_share=0.74, way_mm=4.6).why
    assert said == "as expected, within tolerance; 1.2 of 4.6 mm weren't seen"
    assert decided(seen_share=0.98, way_mm=4.6).why == "as expected, within tolerance"
    assert "0.5 of 5.0 mm" in decided(seen_share=0.5, over_old_share=0.4, way_mm=5.0).why


def test_the_longest_stretches_that_were_not_seen_are_listed():
    """A gap of 1.4 mm under a glint was in a sum of all that wasn't seen."""
    hidden = tuple(
        UnseenPath("vessel 2", Gap(2, at, at + long, (at, 0.0), (at + long, 0.0), 0.0, 1.0), 9.0)
        for at, long in ((0.0, 0.3), (1.0, 1.4), (3.0, 0.5), (5.0, 0.4))
    )
    said = decided(seen_share=0.7, way_mm=9.0, hidden=hidden).why
    assert ": 1.4 of 9.0 mm of vessel 2 (X 1.0 Y 0.0 to X 2.4 Y 0.0), 0.5 of" in said
    assert said.endswith(" and 1 shorter")


@pytest.mark.parametrize(("shows", "kind"), [(0.0, "pause"), (0.1, "pause"), (0.9, "go_on")])
def test_grainy_ink_of_the_first_look_is_ink(shows, kind):
    """In coarse speckle the first look asked whether the needle was clogged."""
    nothing = {"seen_share": 0.0, "coverage": math.nan, "level_mm": 0.2, "flow": flow(1.0, 0)}
    found = decided(faint_share=shows, **nothing)
    assert found.kind == kind
    assert ("gaps of 0.2 mm: longer ones alone are told" in found.why) is (kind == "go_on")
    assert ("no ink is seen yet" in found.why) is (kind == "pause")


def test_a_gap_in_one_of_two_pictures_is_told_and_not_mended():
    found = decided(gaps=(GAP,), second=())
    assert (found.kind, found.gaps) == (DecisionKind.GO_ON, ())
    assert "1 gap, 1.00 mm in all, in one of two pictures alone" in found.why


def test_what_is_remembered_of_a_mend_that_failed_can_be_saved():
    """Ends of a gap in a mend were NumPy's: the look's record wasn't written."""
    decider = Decider(Limits(mend="mend"))
    gap = replace(GAP, from_mm=np.float64(0.0), to_mm=np.float64(3.0))
    assert decider.decide(evidence(gaps=(gap,))).kind is DecisionKind.MEND
    assert json.loads(json.dumps(asdict(decider.layers)))["failed"] is True


def test_a_vessel_of_which_nothing_is_seen_is_asked_about_by_its_name():
    gap = Gap(7, 0.0, 6.6, (0.0, 0.0), (6.0, 0.0), 0.0, 1.0)
    whole = UnseenPath("vessel 2", gap, 6.6, bare=True)
    found = decided(unseen=(whole,), seen_share=0.0, gaps=(GAP,))
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert found.gaps == (GAP, whole.gap)
    assert "nothing is seen of vessel 2 (6.6 mm)" in found.why
    assert decided("tell", unseen=(whole,), seen_share=0.0).kind is DecisionKind.GO_ON


def test_a_part_of_a_vessel_that_is_not_seen_is_asked_about_with_length_and_place():
    part = UnseenPath("vessel 3", Gap(7, 1.0, 3.5, (1.0, 2.0), (3.5, 2.0), 0.0, 1.0), 5.0)
    found = decided(unseen=(part,), seen_share=0.5)
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert "not seen: 2.5 of 5.0 mm of vessel 3 (X 1.0 Y 2.0 to X 3.5 Y 2.0)" in found.why
    assert found.gaps == (part.gap,)
    told = decided("tell", unseen=(part,), seen_share=0.5)
    assert told.kind is DecisionKind.GO_ON
    assert "2.5 of 5.0 mm of vessel 3" in told.why


def test_a_gap_by_level_alone_is_asked_about_where_the_picture_changed():
    """Opaque ink beside a line that touches, level as what it lies on: 0.48 mm mended in vain."""
    found = decided(gaps=(replace(GAP, shaded=True),))
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert decided(gaps=(GAP,)).kind is DecisionKind.MEND


def test_next_to_nothing_seen_is_nothing_seen():
    assert decided(seen_share=0.0006).why == "nothing was seen"


def test_gaps_are_mended_and_flow_with_them():
    found = decided(gaps=(GAP,), flow=flow(0.8))
    assert found.kind is DecisionKind.MEND
    assert found.gaps == (GAP,)
    assert found.factor == pytest.approx(1.25, abs=0.02)


@pytest.mark.parametrize(
    ("changed", "words"),
    [({"way_mm": 2.5}, "40% of what was written"), ({"seen_share": 0.2}, "only 20% was seen")],
)
def test_a_doubtful_picture_is_never_mended_by_unasked(changed, words):
    found = decided(gaps=(GAP,), **changed)
    assert (found.kind, found.ask, found.gaps) == (DecisionKind.PAUSE, DecisionKind.MEND, (GAP,))
    assert words in found.why
    over_old = decided(gaps=(GAP,), seen_share=0.2, over_old_share=0.7)
    assert over_old.kind is DecisionKind.MEND


def test_a_turned_picture_pauses_and_nothing_is_learned_or_mended_by_it():
    decider = Decider(Limits(mend="mend"))
    found = decider.decide(evidence(gaps=(GAP,), flow=flow(0.8), turned="turned by 180°"))
    assert (found.kind, found.ask, found.gaps) == (DecisionKind.PAUSE, None, ())
    assert "fits the layer better turned by 180°: check the device's axes" in found.why
    assert decider.decide(evidence()).kind is DecisionKind.GO_ON


def test_a_map_of_which_a_part_is_moved_pauses_and_names_lost_rows():
    decider = Decider(Limits(mend="mend"))
    moved = "moved by +0.4 mm along x and +0.0 mm along y at one end against the other"
    found = decider.decide(evidence(gaps=(GAP,), turned=moved))
    assert (found.kind, found.gaps) == (DecisionKind.PAUSE, ())
    assert "the map lacks rows or columns" in found.why


def test_gaps_in_a_map_that_lacks_rows_are_asked_about_and_no_flow_is_learned():
    decider = Decider(Limits(mend="mend"))
    lacks = MapCheck("lacks 20 of 300 rows (400 µm) against the last look's")
    found = decider.decide(evidence(gaps=(GAP,), flow=flow(0.8), map=lacks))
    assert (found.kind, found.ask, found.gaps) == (DecisionKind.PAUSE, DecisionKind.MEND, (GAP,))
    assert "lacks 20 of 300 rows (400 µm) against the last look's" in found.why
    goes_on = decider.decide(evidence(map=lacks))
    assert goes_on.kind is DecisionKind.GO_ON
    assert "the map lacks 20 of 300 rows" in goes_on.why


def test_a_layer_that_a_map_without_some_rows_shows_aside_or_bare_isnt_called_moved_or_clogged():
    lacks = MapCheck("lacks 20 of 300 rows (400 µm) against the last look's")
    aside = decided(map=lacks, shift_mm=0.4, u_shift_mm=0.01)
    clogged = decided(map=lacks, supply=InkSupply(SupplyState.CLOGGED, 1.0, 3.0, 0), gaps=(GAP,))
    for found in (aside, clogged):
        assert found.kind is DecisionKind.PAUSE
        assert found.why.startswith("the map lacks 20 of 300 rows")
    assert (aside.ask, clogged.ask) == (None, DecisionKind.MEND)


def test_gaps_of_a_map_that_nothing_tells_to_be_whole_are_asked_about():
    found = decided(gaps=(GAP,), map=MapCheck(unsized=True))
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert "nothing tells whether the map is whole" in found.why
    assert decided(map=MapCheck(unsized=True)).kind is DecisionKind.GO_ON


def test_blobs_and_sunken_ground_of_a_map_are_told():
    outline = np.zeros((4, 2))
    blobs = tuple(
        Blob("blob", (10.0 + k, 20.0), outline, 0.2 + 0.1 * k, True, 1e-6, 0.21) for k in range(4)
    )
    why = decided(blobs=blobs, map=MapCheck(sunk_mm=0.12)).why
    assert "4 blobs stand on the layer (X 13.0 Y 20.0, 0.80 mm wide, 210 µm over the ink;" in why
    assert "and 1 smaller)" in why
    assert "has sunk by up to 120 µm" in why


def test_what_a_profilers_map_doesnt_judge_is_said():
    short = decided(least_gap_mm=0.35).why
    assert "gaps shorter than 0.35 mm may not show (gap_mm is 0.2)" in short
    assert "may not show" not in decided(least_gap_mm=0.15).why
    even, wavering = (decided(by_height_share=0.8, waver=one).why for one in (0.06, 0.17))
    assert "on 80% (over older ink) gaps are told and no widths" in even
    assert "wavers there by 6% of a layer" in even
    assert "more than the 15 %" not in even
    assert "wavers there by 17% of a layer, more than the 15 % that widths may be off" in wavering


def test_lines_that_touch_and_tell_nothing_of_their_widths_are_said():
    words = "on 56% lines touch, and it isn't seen whether they are thin"
    assert words in decided(untold_seams=0.56).why
    assert "touch" not in decided(untold_seams=0.05).why


def test_ink_that_may_be_thin_on_older_ink_is_told_with_its_place() -> None:
    low = Gap(3, 2.0, 9.0, (100.0, 101.0), (107.0, 101.0), 0.0, 1.0)
    found = decided(by_height_share=0.8, waver=0.03, low=(low,))
    assert found.kind is DecisionKind.GO_ON
    assert "along 7.0 mm it stands more than 15 % of a layer lower than elsewhere" in found.why
    assert "(X 100.0 Y 101.0 to X 107.0 Y 101.0, 7.0 mm): ink may be thin there" in found.why


def test_a_way_without_ink_is_never_called_as_expected():
    bare = decided(coverage=0.003, seen_share=0.2, over_old_share=0.3)
    assert bare.kind is DecisionKind.PAUSE
    assert "ink lies on 0% of what was seen (20%)" in bare.why
    assert decided(coverage=0.003, seen_share=0.2, gaps=(GAP,)).ask is DecisionKind.MEND
    for sound in ({"coverage": 0.69}, {"coverage": 0.0, "way_mm": 0.9}, {"coverage": math.nan}):
        assert decided(**sound).kind is DecisionKind.GO_ON


def test_thin_lines_are_corrected():
    found = decided(flow=flow(0.8))
    assert found.kind is DecisionKind.FLOW
    assert found.factor == pytest.approx(1.25, abs=0.02)


def test_thin_lines_are_filled_up_and_the_flow_corrected():
    thin = (Thin(3, 0.0, 7.0, 0.3),)
    found = decided(thin=thin, flow=flow(0.7))
    assert (found.kind, found.thin, found.gaps) == (DecisionKind.MEND, thin, ())
    assert found.factor == pytest.approx(1.43, abs=0.03)
    assert "7.00 mm of thin lines" in found.why
    assert decided("ask", thin=thin).ask is DecisionKind.MEND


def test_lines_that_seem_thin_are_filled_up_only_where_the_flow_is_proven_too_small():
    seem = (Thin(3, 0.0, 7.0, 0.3),)
    found = decided(seem_thin=seem, flow=flow(0.7))
    assert (found.kind, found.thin) == (DecisionKind.MEND, seem)
    assert decided(seem_thin=seem).kind is DecisionKind.GO_ON
    assert decided(seem_thin=seem, flow=flow(1.3)).kind is DecisionKind.FLOW


def test_a_clog_pauses_and_keeps_what_is_missing():
    clogged = InkSupply(SupplyState.CLOGGED, 0.3, 0.3, 1)
    found = decided(supply=clogged, gaps=(GAP,), flow=flow(0.3))
    assert found.kind is DecisionKind.PAUSE
    assert found.gaps == (GAP,)
    assert "clogged" in found.why


@pytest.mark.parametrize("kind", ["gaps", "flow"])
def test_ask_pauses_with_a_proposal_and_tell_goes_on(kind):
    wrong = {"gaps": (GAP,)} if kind == "gaps" else {"flow": flow(0.8)}
    asked, told = decided("ask", **wrong), decided("tell", **wrong)
    assert asked.kind is DecisionKind.PAUSE
    assert asked.ask is (DecisionKind.MEND if kind == "gaps" else DecisionKind.FLOW)
    assert told.kind is DecisionKind.GO_ON


def test_a_shift_pauses_and_stops_where_it_grows():
    decider = Decider(Limits(mend="mend"))
    assert decider.decide(evidence(shift_mm=0.3, u_shift_mm=0.02)).kind is DecisionKind.PAUSE
    assert decider.decide(evidence(shift_mm=0.6, u_shift_mm=0.02)).kind is DecisionKind.STOP
    assert decided(shift_mm=0.3, u_shift_mm=0.1).kind is DecisionKind.GO_ON


def test_a_closed_lumen_pauses():
    assert decided(narrowed=(Narrowed("5", 0.0, 0.02),)).kind is DecisionKind.PAUSE
    assert decided(narrowed=(Narrowed("5", 0.85, 0.05),)).kind is DecisionKind.GO_ON


def test_gaps_beside_a_narrowed_lumen_are_offered():
    """A lumen called narrow hid 100 mm of true gaps: they were never mentioned again."""
    decision = decided(narrowed=(Narrowed("5", 0.4, 0.02),), gaps=(GAP,), second=(GAP,))
    assert decision.ask is DecisionKind.MEND
    assert decision.gaps == (GAP,)


def test_what_readings_share_is_never_known_better():
    decider = Decider(Limits(mend="mend"))
    blocks = FlowBlocks(np.zeros(50), np.full(50, 0.96), np.full(50, 0.03), np.ones(50), 0.03)
    assert decider.decide(evidence(flow=blocks)).kind is DecisionKind.GO_ON


def test_a_flow_beyond_all_bounds_pauses():
    assert decided(flow=flow(0.2, 300)).kind is DecisionKind.PAUSE


def test_a_flow_beyond_all_bounds_pauses_where_a_look_tells_it():
    """A clog in part that was over paused at each look that told no width; once is enough."""
    decider = Decider(Limits(mend="mend"))
    assert decider.decide(evidence(flow=flow(0.3))).kind is DecisionKind.PAUSE
    untold = decider.decide(evidence(flow=flow(1.0, 0)))
    assert untold.kind is DecisionKind.PAUSE
    assert "tells no width" in untold.why
    assert decider.decide(evidence(flow=flow(1.0, 0))).kind is DecisionKind.GO_ON
    assert decider.decide(evidence(flow=flow(0.3))).kind is DecisionKind.PAUSE


def test_as_much_ink_beside_the_lines_as_is_missing_is_asked_about():
    """A height map with x and y exchanged: 5.8 mm of sound rings were mended unasked."""
    found = decided(gaps=(GAP,), beside_mm=2.0)
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert "2.0 mm of a line lie where none should" in found.why
    assert decided(gaps=(GAP,), beside_mm=0.3).kind is DecisionKind.MEND
    assert decided(beside_mm=2.0).kind is DecisionKind.GO_ON


def test_a_gap_that_the_layer_has_by_one_of_two_places_is_asked_about():
    """A missing outermost line, taken for a shift, had the sound line beside it mended."""
    found = decided(unplaced=(GAP,), shift_mm=0.05, u_shift_mm=0.07)
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, None)
    assert "nothing tells which" in found.why


def test_a_gap_that_a_second_picture_hardly_sees_is_asked_about():
    found = decided(gaps=(GAP,), second=(), half_seen=(GAP,))
    assert (found.kind, found.ask, found.gaps) == ("pause", "mend", (GAP,))
    assert decided(gaps=(GAP,), second=()).kind is DecisionKind.GO_ON
    short = replace(GAP, to_mm=0.07, u_tip_mm=0.1)  # within tolerance, as far as is known
    assert decided(gaps=(short,), second=(), half_seen=(short,)).kind is DecisionKind.GO_ON


def test_a_layer_that_lies_aside_is_told_so_however_unsure_by_how_much():
    found = decided(shift_mm=0.3, u_shift_mm=0.29, aside=True)
    assert found.kind is DecisionKind.PAUSE
    assert "0.30 mm beside its place" in found.why
    assert decided(shift_mm=0.3, u_shift_mm=0.29).kind is DecisionKind.GO_ON


@pytest.mark.parametrize(("apart", "asked"), [(0.1, True), (0.5, False)])
def test_what_cannot_be_told_next_to_a_gap_is_asked_about(apart: float, asked: bool):
    """Of 2 mm bare that ran into a crossing 0.5 mm were mended, without a word on the rest."""
    begin = GAP.to_mm + apart
    rest = replace(GAP, from_mm=begin, to_mm=begin + 1.0)
    found = decided(gaps=(GAP,), hidden=(UnseenPath("vessel 2", rest, 9.0),))
    if not asked:
        assert (found.kind, found.gaps) == (DecisionKind.MEND, (GAP,))
        return
    assert (found.kind, found.ask, found.gaps) == ("pause", "mend", (GAP, rest))
    assert "1.0 of 9.0 mm of vessel 2" in found.why
