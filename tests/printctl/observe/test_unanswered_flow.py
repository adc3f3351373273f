"""Corrections of the flow that the amount of ink seen doesn't answer are taken back."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from printctl.observe.deciding import Decider, DecisionKind, FlowBlocks, FlowControl, Limits
from printctl.observe.deciding.evidence import Thin
from printctl.observe.observer import restore, state_of
from tests.printctl.observe.decisions import evidence
from tests.printctl.observe.observer_bench import LOOK, Bench

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


@pytest.mark.parametrize("step", [0.7, 1.3])
@pytest.mark.parametrize("at", range(13, 25))
def test_a_step_of_the_flow_within_a_look_is_answered(step, at):
    decider, decisions = printed(at, lambda second, factor: factor * (step if second >= at else 1))
    assert not [one for one in decisions if one.kind is DecisionKind.PAUSE]
    assert decider.control.factor * step == pytest.approx(1.0, abs=0.07)


@pytest.mark.parametrize("seed", range(10))
def test_a_flow_that_falls_for_long_is_answered(seed):
    """Each look sees what the flow lost since the last correction: no sign of no answer."""
    decider, decisions = printed(
        seed, lambda second, factor: factor * math.exp(-0.015 * max(0, second - 10)), looks=6
    )
    assert not [one for one in decisions if one.kind is DecisionKind.PAUSE]
    assert decider.control.factor > 1.2


def test_the_last_correction_that_was_answered_stays():
    """The flow fell; later light made lines look wide, and factors were lost on that."""
    decider, decisions = printed(
        3, lambda second, factor: 0.7 * factor if second < 24 else 1.4, looks=9
    )
    assert decider.control.answers.failed
    assert decider.control.factor == pytest.approx(1 / 0.7, abs=0.11)
    assert sum(one.kind is DecisionKind.PAUSE for one in decisions) == 1


def failed(mode="mend", factor=0.7):
    decider = Decider(Limits(mend=mode), FlowControl(factor=factor))
    decider.control.answers.failed = True
    return decider


def test_thin_lines_are_not_filled_up_by_widths_that_answer_nothing():
    thin = (Thin(1, 0.0, 4.0, 0.4),)
    decision = failed().decide(evidence(thin=thin, seem_thin=thin))
    assert decision.kind is DecisionKind.PAUSE
    assert decision.thin == ()


def test_the_operator_is_asked_where_all_is_asked_and_told_alone_where_all_is_told():
    asked, told = failed("ask").decide(evidence()), failed("tell").decide(evidence())
    assert (asked.kind, asked.ask, asked.factor) == (DecisionKind.PAUSE, DecisionKind.FLOW, 1.0)
    assert told.kind is DecisionKind.GO_ON
    assert told.factor is None


def test_another_observer_goes_on_with_what_was_seen_of_answers():
    rng, first, other = np.random.default_rng(1), Decider(), Decider()
    first.control.learn(looked(rng, 0.0, [1.4] * 6, 1.0))
    first.control.put_in_force(0.72)
    restore(other, json.loads(json.dumps(state_of(first))))
    for one in (first, other):
        one.control.put_in_force(0.72)
        one.control.learn(looked(np.random.default_rng(2), 6.0, [1.4] * 6, 0.72))
    assert other.control.answers.failed
    assert other.control.answers == replace(first.control.answers, last=other.control.answers.last)


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
