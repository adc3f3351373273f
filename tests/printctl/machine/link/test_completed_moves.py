"""Count of certainly executed lines: a lower bound, exact at standstill."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from printctl.machine.link.completed_moves import CompletedMoves

MARLIN = load(Printer, "generic_marlin")
AHEAD = MARLIN.planner_blocks + MARLIN.command_queue
lines = st.lists(st.sampled_from([b"G1 X1", b"G0 Z2", b"M105", b"G4 P10"]), max_size=80)


@given(lines, st.data())
def test_as_many_moves_as_planner_and_queue_hold_may_be_ahead(job, data):
    made, last = CompletedMoves(job, MARLIN), 0
    for taken in sorted(data.draw(st.lists(st.integers(0, len(job)), max_size=6))):
        found = made.after(taken)
        ahead = sum(line[:1] == b"G" and line[:2] != b"G4" for line in job[found:taken])
        assert last <= found <= taken
        assert found == 0 or ahead == AHEAD
        last = found


@pytest.mark.parametrize("taken", [1, 40])
def test_of_a_planner_by_time_only_a_standstill_counts(taken):
    klipper = MARLIN.model_copy(update={"firmware": "klipper"})
    made = CompletedMoves([b"G1 X1"] * 50, klipper)
    assert made.after(taken) == 0
    made.waited(taken)
    assert made.after(taken) == taken
