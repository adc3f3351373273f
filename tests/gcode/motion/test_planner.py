"""Planner and stepper, against analytic cases, properties and a slow stepper."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from gcode.motion.planner import (
    add_move,
    next_event,
    pulses_per_interrupt,
    run_until,
    set_trapezoid,
    timer_interval,
    walk,
)
from gcode.motion.state import BLOCK, LOG, new_planner, new_ring
from tests.slower import examples


def pulse_times(block):
    """Ticks from a block's start to each of its pulses."""
    slope = int(int(block["acceleration_rate"]) * (2**24 / 2_000_000))
    initial, nominal = int(block["initial_rate"]), int(block["nominal_rate"])
    final, events = int(block["final_rate"]), int(block["events"])
    up, down = int(block["accelerate_before"]), int(block["decelerate_start"])
    pulses = pulses_per_interrupt(initial)
    interval = timer_interval(initial // pulses)
    rising = falling = interval // 2
    peak, cruising = initial, False
    ticks, times = 0, []
    while True:
        ticks += interval + 1
        times += [ticks] * pulses
        done = len(times)
        if done >= events:
            return times[:events]
        if done < up:
            rate = peak = min((rising * slope >> 24) + initial, nominal)
        elif done >= down:
            rate = max(peak - (falling * slope >> 24), final)
        else:
            rate = peak = nominal
        pulses = pulses_per_interrupt(rate)
        interval = timer_interval(rate // pulses)
        if done < up:
            rising += interval
            falling = 0
        elif done >= down:
            falling += interval
        elif not cruising:
            cruising = True
            falling = interval // 2


PROFILE = load(Printer, "marlin_avr")
STEPS = np.array([80, 80, 400, 500])


class Bench:
    """A planner that is fed as fast as it takes moves."""

    def __init__(self, start=(0.0, 0.0, 0.0), profile=PROFILE):
        self.planner, self.ring = new_planner(profile, start), new_ring(profile)
        self.log = np.zeros(4000, LOG)
        self.now = 0.0

    def move(self, *target, feed=20.0, line=0):
        run_until(self.planner, self.ring, self.log, self.now)
        while self.planner["count"][0] == len(self.ring) - 1:
            self.now = max(self.now, next_event(self.planner))
            run_until(self.planner, self.ring, self.log, self.now)
        return add_move(self.planner, self.ring, np.array(target, float), feed, line, self.now)

    def finish(self):
        run_until(self.planner, self.ring, self.log, 1e9)
        return self.log[: self.planner["logged"][0]]

    @property
    def physical(self):
        return self.planner["physical"][0].copy()

    @property
    def span(self):
        return float(self.planner["run_end"][0] - self.planner["first_pulse"][0])


@pytest.mark.parametrize(("length", "speed"), [(50, 10), (100, 60), (1, 20), (0.5, 100)])
def test_a_single_move_takes_the_time_of_its_trapezoid(length, speed):
    bench = Bench()
    bench.move(length, 0, 0, 0, feed=speed)
    bench.finish()
    acceleration = 3000.0
    if speed**2 / acceleration <= length:
        expected = length / speed + speed / acceleration
    else:
        expected = 2 * math.sqrt(length / acceleration)
    assert bench.span == pytest.approx(expected, rel=0.002, abs=0.006)


def test_a_right_angle_is_entered_at_the_junction_deviation_speed():
    bench = Bench()
    bench.move(10, 0, 0, 0)
    bench.move(10, 10, 0, 0)
    half_sine = math.sqrt(0.5)
    expected = 3000 * 0.013 * half_sine / (1 - half_sine)
    assert bench.ring["entry_sq"][1] == pytest.approx(expected, rel=1e-4)


coordinate = st.integers(0, 400).map(lambda n: n * 0.05)
targets = st.lists(
    st.tuples(coordinate, coordinate, st.sampled_from([0.0, 0.06, 0.12]), coordinate),
    min_size=1,
    max_size=40,
)


@given(targets, st.integers(1, 150))
@settings(max_examples=examples(40), deadline=None)
def test_no_step_is_lost_and_blocks_follow_one_another(points, feed):
    bench = Bench()
    taken = [point for point in points if bench.move(*point, feed=float(feed))]
    log = bench.finish()
    assert len(log) == len(taken)
    last = np.array(taken[-1]) if taken else np.zeros(4)
    assert np.abs(bench.physical - last * STEPS).max() <= 0.51
    assert (np.abs(np.array(points[-1]) * STEPS - bench.physical) < 6.5).all()
    np.testing.assert_array_equal(log["start"][1:], log["end"][:-1])
    assert (log["time_start"][1:] >= log["time_end"][:-1] - 1e-9).all()
    assert (log["time_end"] > log["time_start"]).all()


@given(targets)
@example([(0.0, 1.5, 0.0, 0.0), (0.0, 1.5, 0.06, 0.0), (0.0, 0.0, 0.0, 0.0)])
@settings(max_examples=examples(40), deadline=None)
def test_a_planned_chain_never_asks_for_more_than_its_acceleration(points):
    bench = Bench()
    for point in points[:14]:
        bench.move(*point, feed=80.0)
    age = np.arange(bench.planner["count"][0])
    blocks = bench.ring[(bench.planner["tail"][0] + age) % len(bench.ring)]
    entry, leave = blocks["entry_sq"][:-1], blocks["entry_sq"][1:]
    room = 2.0 * blocks["acceleration"][:-1] * blocks["millimetres"][:-1]
    room = room * (1 + 1e-5) + blocks["least_sq"][:-1]
    # No block is entered below its least speed, whether the one before can reach it or not.
    assert (leave <= np.maximum(entry + room, blocks["least_sq"][1:] * (1 + 1e-6))).all()
    assert (entry - leave <= room).all()
    assert (blocks["entry_sq"] <= blocks["max_entry_sq"] * (1 + 1e-6)).all()


def trapezoid(events, nominal, acceleration, entry, leave):
    block = np.zeros(1, BLOCK)
    block["events"], block["nominal_rate"] = events, nominal
    block["acceleration_rate"], block["steps_per_mm"] = acceleration, 80.0
    set_trapezoid(block[0], entry, leave)
    return block


blocks = st.builds(
    trapezoid,
    st.integers(1, 3000),
    st.integers(40, 24000),
    st.integers(100, 240_000),
    st.floats(0.5, 40),
    st.floats(0.5, 40),
).filter(lambda b: max(b["initial_rate"][0], b["final_rate"][0]) <= b["nominal_rate"][0])


@given(blocks, st.floats(0, 1))
@settings(max_examples=examples(150), deadline=None)
def test_the_stepper_gives_each_pulse_when_the_slow_one_does(block, share):
    times = pulse_times(block[0])
    events, ticks, first = walk(block[0], -1)
    assert (events, ticks, first) == (len(times), times[-1], times[0])
    limit = int(share * times[-1])
    done, _, _ = walk(block[0], limit)
    assert done == sum(time <= limit for time in times)
