"""A flow that is likely off, though widths don't tell it surely, is asked about."""

import json

import numpy as np
import pytest

from printctl.observe.deciding import Decider, DecisionKind, FlowBlocks, Limits
from printctl.observe.observer import restore, state_of
from tests.printctl.observe.decisions import evidence


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


def test_a_change_is_asked_about_though_levels_are_unsure():
    decider = Decider(Limits(mend="mend"))
    kinds = [decider.decide(look(ratio, 0.2)).ask for ratio in (1.1, 1.1, 0.75, 0.75, 1.1)]
    assert kinds == [None, None, DecisionKind.FLOW, None, None]


def test_what_was_approved_is_what_flows_from_then_on():
    decider = Decider(Limits(mend="mend"))
    found = decider.decide(look(0.7, 0.12))
    decider.control.put_in_force(found.factor)
    for _ in range(4):
        assert decider.decide(look(0.7 * found.factor, 0.12, found.factor)).factor is None


def test_what_was_asked_is_kept_for_another_observer():
    decider, other = Decider(Limits(mend="mend")), Decider(Limits(mend="mend"))
    assert decider.decide(look(0.7, 0.12)).ask is DecisionKind.FLOW
    restore(other, json.loads(json.dumps(state_of(decider))))
    assert other.decide(look(0.7, 0.12)).ask is None
