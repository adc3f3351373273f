"""Flow control: steps found, noise let be, bounds kept, no wind-up."""

import math

import numpy as np
import pytest

from printctl.observe.deciding import FlowBlocks, FlowControl


def blocks(begin_s, ratios, u=0.03, factor=1.0):
    count = len(ratios)
    time = begin_s + np.arange(count, dtype=float)
    return FlowBlocks(time, np.asarray(ratios), np.full(count, u), np.full(count, factor))


def noisy(rng, mean, count, u=0.03):
    return mean * (1 + u * rng.standard_normal(count))


def closed_loop(flow, seconds, rng, control, begin_s=0.0):
    """Look every 5 s at what was written, of a needle that delivers ``flow`` of what is asked."""
    for k in range(seconds // 5):
        seen = noisy(rng, flow * control.factor, 5)
        control.learn(blocks(begin_s + 5.0 * k, seen, factor=control.factor))
        factor = control.proposal()
        if factor is not None:
            control.put_in_force(factor)


@pytest.mark.parametrize("flow", [0.7, 1.3])
def test_a_step_is_within_5_percent_after_10_seconds(flow):
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(50):
        control = FlowControl()
        closed_loop(1.0, 60, rng, control)
        closed_loop(flow, 10, rng, control, 60.0)
        wrong += abs(flow * control.factor - 1) > 0.05
    assert wrong <= 2


def test_noise_alone_changes_little():
    rng = np.random.default_rng(4)
    control = FlowControl()
    closed_loop(1.0, 600, rng, control)
    assert abs(control.factor - 1) <= 0.03


def test_slow_drift_is_followed():
    rng = np.random.default_rng(5)
    control = FlowControl()
    for k in range(120):
        flow = math.exp(-0.3 * k / 120)
        closed_loop(flow, 5, rng, control, 5.0 * k)
        assert abs(flow * control.factor - 1) < 0.08


def test_a_bound_is_kept_and_left_at_once():
    control = FlowControl()
    control.learn(blocks(0.0, np.full(200, 0.2)))
    assert control.out_of_bounds
    assert control.proposal() == control.limits.high
    control.put_in_force(control.limits.high)
    control.learn(blocks(200.0, np.full(10, 1.7), factor=1.7))  # the needle is free again
    assert control.proposal() == pytest.approx(1.0, abs=0.02)


def test_readings_of_an_older_factor_count_as_what_they_were():
    control = FlowControl()
    control.learn(blocks(0.0, np.full(30, 0.8)))
    control.put_in_force(1.25)
    control.learn(blocks(30.0, np.full(5, 0.8), factor=1.0))
    assert control.proposal() is None


def picture(rng, mean, begin_s, factor, bias):
    """Readings of one picture: they share what it may be off by."""
    seen = noisy(rng, mean * factor * bias, 4, 0.02)
    return FlowBlocks(begin_s + np.arange(4.0), seen, np.full(4, 0.032), np.full(4, factor), 0.025)


def test_widths_that_pictures_misread_a_little_are_not_corrected():
    wrong = 0
    for seed in range(300):
        rng, control = np.random.default_rng(seed), FlowControl()
        for k in range(16):
            control.learn(picture(rng, 1.0, 20.0 * k, 1.0, 1 + 0.025 * rng.standard_normal()))
            wrong += control.proposal() is not None
    assert wrong <= 4  # of 4,800 looks


def test_a_step_within_a_look_is_known_though_widths_are_unsure():
    """Before and behind it a picture misreads widths alike: it took another look, 5 s more."""
    control = FlowControl()
    for k in range(3):
        seen = np.ones(4) if k < 2 else np.array([0.81, 0.7, 0.7, 0.71])
        u = np.hypot(0.01, 0.07) * seen
        control.learn(FlowBlocks(4.0 * k + np.arange(4.0), seen, u, np.ones(4), 0.07))
    assert control.proposal() == pytest.approx(1 / 0.7, abs=0.06)


def test_a_picture_that_is_less_sure_than_the_last_is_no_step():
    """Widths by the change alone looked 17 % narrow; the flow was corrected by that."""
    control = FlowControl(factor=1.41)
    for common, seen in ((0.05, 0.985), (0.05, 0.985), (0.1, 0.82)):
        full = np.full(4, seen)
        control.learn(FlowBlocks(np.arange(4.0), full, common * full, np.full(4, 1.41), common))
    assert abs((control.proposal() or 1.41) - 1.41) < 0.1
