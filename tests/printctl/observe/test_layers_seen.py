"""Decisions by how much earlier looks saw, and what nothing told of."""

import json
from dataclasses import replace

import pytest

from printctl.observe.deciding import (
    Decider,
    DecisionKind,
    InkSupply,
    Limits,
    SupplyState,
)
from printctl.observe.observer import restore, state_of
from registration.inspection.findings import ToldOfInk
from registration.inspection.values import Gap
from tests.printctl.observe.decisions import GAP, decided, evidence


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


def test_a_first_layer_of_which_no_ink_is_seen_can_be_written_again():
    """A needle clogged from the start paused, proposed nothing, and 82 mm stayed bare."""
    bare = {"seen_share": 0.0, "coverage": float("nan"), "level_mm": 0.1}
    tail = (stretch(0, 6.0), stretch(1, 4.0))
    found = Decider(Limits(mend="mend")).decide(
        evidence(**bare, told=ToldOfInk(head_mm=10.0, untold=tail, tail=tail))
    )
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert found.gaps == tail
    assert "no ink is seen yet" in found.why


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


def test_ink_that_comes_by_the_change_alone_is_no_blindness():
    decider = Decider(Limits(mend="mend"))
    came = untold(8.0, told=ToldOfInk(came_mm=8.0, ink_mm=8.0), older_step=0.05)
    found = [decider.decide(came) for _ in range(12)]
    assert {one.kind for one in found} == {DecisionKind.GO_ON}
    assert "along 8.0 mm the picture changed as by fresh ink" in found[0].why


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


def test_what_did_not_change_beside_what_did_is_asked_about():
    still = ToldOfInk(came_mm=90.0, ink_mm=90.0, still=(stretch(4, 3.0), stretch(5, 1.0)))
    found = decided(seen_share=0.0, told=still, level_mm=0.2)
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert [one.stroke for one in found.gaps] == [4]
    assert "nothing has changed along 3.0 mm" in found.why


def test_a_stretch_that_looks_bare_though_the_picture_changed_is_asked_about():
    bare = ToldOfInk(ink_mm=90.0, doubted=(stretch(4, 2.2), stretch(5, 1.0)))
    found = decided(told=bare, level_mm=0.2)
    assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
    assert [one.stroke for one in found.gaps] == [4]
    assert "2.2 mm (X 98.0 Y 101.0 to X 100.2 Y 101.0, 2.2 mm) look bare" in found.why


THIN = ToldOfInk(came_mm=90.0, ink_mm=90.0, thin=(stretch(4, 6.0),))


def test_ink_that_may_be_thin_is_asked_about_and_half_of_it_written_again():
    """Clogs in part over older ink went on as "the picture changed as by fresh ink"."""
    for mode in ("mend", "ask"):
        found = decided(mode, told=THIN, level_mm=0.2)
        assert (found.kind, found.ask) == (DecisionKind.PAUSE, DecisionKind.MEND)
        assert [(one.stroke, one.length_mm, one.missing) for one in found.thin] == [(4, 6.0, 0.5)]
        assert "along 6.0 mm (X 98.0 Y 101.0 to X 104.0 Y 101.0, 6.0 mm)" in found.why
        assert "ink may be thin there" in found.why


def test_ink_that_may_be_thin_is_told_where_nothing_is_asked_or_something_else_is_done():
    told = decided("tell", told=THIN, level_mm=0.2)
    mended = decided(gaps=(GAP,), told=THIN, level_mm=0.2)
    assert (told.kind, mended.kind) == (DecisionKind.GO_ON, DecisionKind.MEND)
    assert not mended.thin
    assert all("ink may be thin there" in one.why for one in (told, mended))


def test_a_look_says_along_how_much_ink_that_came_may_be_thin_untold():
    told = ToldOfInk(came_mm=20.0, ink_mm=20.0, thin_untold_mm=12.0)
    assert "aren't told, nor along 12.0 mm whether it is thin" in decided(told=told).why


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


def test_a_state_of_an_older_release_is_restored():
    decider = Decider(Limits())
    state = state_of(decider)
    restore(decider, {name: state[name] for name in state if name not in ("common", "answers")})
    assert decider.control.answers.last is None


def test_three_blind_looks_pause():
    decider = Decider(Limits(mend="mend"))
    kinds = [decider.decide(evidence(seen_share=0.2)).kind for _ in range(3)]
    assert kinds == [DecisionKind.GO_ON, DecisionKind.GO_ON, DecisionKind.PAUSE]


def test_a_print_of_which_no_ink_is_seen_pauses_at_its_first_look_and_once():
    """A needle that was clogged from the first line on wrote two layers of nothing before."""
    decider = Decider(Limits(mend="mend"))
    nothing = {"seen_share": 0.0, "way_mm": 4.0, "level_mm": 0.1}
    kinds = [decider.decide(evidence(**nothing)).kind for _ in range(3)]
    assert kinds == [DecisionKind.GO_ON, DecisionKind.PAUSE, DecisionKind.GO_ON]


def test_ink_once_seen_may_be_hidden_for_a_while():
    decider = Decider(Limits(mend="mend"))
    assert decider.decide(evidence(seen_share=0.1, level_mm=0.1)).kind is DecisionKind.GO_ON
    assert decider.decide(evidence(seen_share=0.0, level_mm=0.1)).kind is DecisionKind.GO_ON


def test_looks_within_a_layer_count_as_one_layer():
    decider = Decider(Limits(mend="mend"))

    def looks(level, *shares):
        for share in shares:
            kind = decider.decide(evidence(seen_share=share, way_mm=20.0, level_mm=level)).kind
        return kind

    assert looks(1.0, 0.2, 0.3, 0.2, 0.1) is DecisionKind.GO_ON
    assert looks(1.1, 0.1, 0.9, 0.9) is DecisionKind.GO_ON
    assert decider.layers.unseen == 0
    assert looks(1.2, 0.1, 0.1) is DecisionKind.GO_ON
    assert looks(1.3, 0.1) is DecisionKind.GO_ON
    assert looks(1.4, 0.1) is DecisionKind.PAUSE


def test_ink_over_ink_that_nothing_tells_apart_pauses_nobody():
    decider = Decider(Limits(mend="mend"))
    found = [decider.decide(evidence(seen_share=0.0, over_old_share=0.98)) for _ in range(4)]
    assert {one.kind for one in found} == {DecisionKind.GO_ON}
    assert "older ink" in found[-1].why


def test_a_view_in_which_little_is_seen_pauses_at_each_third_layer():
    """Five sound layers in a row that showed nothing paused after the third and at every look."""
    decider = Decider(Limits(mend="mend"))
    decider.decide(evidence(level_mm=0.1))
    levels = (0.2, 0.3, 0.4, 0.4, 0.5, 0.6, 0.7)
    found = [decider.decide(evidence(level_mm=z, seen_share=0.1)).kind for z in levels]
    assert [k for k, kind in enumerate(found) if kind is DecisionKind.PAUSE] == [2, 6]


def test_a_layer_in_which_the_picture_changed_as_by_ink_is_seen():
    decider = Decider(Limits(mend="mend"))
    decider.decide(evidence(level_mm=0.1))
    came = ToldOfInk(came_mm=60.0, ink_mm=60.0)
    found = [
        decider.decide(evidence(level_mm=z, seen_share=0.1, told=came)).kind
        for z in (0.2, 0.3, 0.4, 0.5)
    ]
    assert set(found) == {DecisionKind.GO_ON}
