"""Random lives of prints: no line lost or doubled, and no more reported than is true."""

from __future__ import annotations

from collections import Counter

import pytest

from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.model import Life, live_through

PART = 10_000


def assert_all_kinds(lives: list[Life]) -> None:
    """The lives were worth living: they ended in each way, and much went wrong in them."""
    ends = Counter(life.status.state for life in lives if life.status is not None)
    assert {LinkState.DONE, LinkState.STOPPED} <= set(ends)
    assert sum("host died" in life.log for life in lives) > 0


@pytest.mark.parametrize("seed", range(0, 10 * PART, PART))
def test_motors_make_each_line_once_whatever_happens(seed):
    lives = live_through(PART, seed)
    assert sum(life.events for life in lives) >= PART
    assert_all_kinds(lives)


def test_inserts_and_failures_are_among_what_lives_meet():
    # rarer than the rest: a part of the lives may have none
    lives = live_through(2 * PART, 0)
    assert any(life.journal.history().inserts for life in lives)
    assert any(life.status and life.status.state is LinkState.FAILED for life in lives)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10**6, 10**6 + 100 * PART, PART))
def test_motors_make_each_line_once_in_a_million_events(seed):
    live_through(PART, seed)


FOUND = {
    192: "host that died on the way back, after an attempt that found nothing: refused as ended",
    20029: "number cut off a line by a flushed buffer: made, and found by its place",
    20357: "the same, made good by the next line: an alarm names it",
    22061: "token whose echo was garbled while a command waited: its answer was never handed over",
    5075: "attempt to go on whose records a full disk lost: lines were counted wrong",
    579: "second doubt of the place while the first was being cleared: the print stood",
    500168: "host that died on its way back after a lost port: refused as ended, as resuming",
    70363: "silent reset while a token was in flight behind M400: the print waited for ever",
    1610016: "silent reset on a stop's way out: the needle was said to be up",
    32819: "stop at the end of a move, within the decimals of M114",
}


@pytest.mark.parametrize("seed", FOUND)
def test_life_in_which_something_was_found(seed):
    Life(seed).live()
