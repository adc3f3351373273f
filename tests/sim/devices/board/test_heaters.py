"""Simulated heater, against Newton's law of cooling integrated step by step."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.devices.board.machine import ROOM_C, Heater


def stepped(heater, target, seconds, step=0.01):
    """Explicit Euler, with a controller that is on below the target and off above."""
    temperature = ROOM_C
    for _ in range(round(seconds / step)):
        end = heater.hottest_c if temperature < target else ROOM_C
        temperature += (end - temperature) * step / heater.time_constant_s
    return temperature


@pytest.mark.parametrize("seconds", [1, 3, 10])
def test_heating_agrees_with_small_steps(seconds):
    heater = Heater(400.0, 60.0)
    heater.set_target(0.0, 40.0)
    assert heater.read(seconds) == pytest.approx(stepped(heater, 40.0, seconds), abs=0.1)


@given(st.floats(22, 300), st.floats(0, 2000), st.floats(0, 2000))
def test_temperature_rises_to_the_target_and_never_over_it(target, a, b):
    heater = Heater(400.0, 60.0)
    heater.set_target(0.0, target)
    early, late = sorted((a, b))
    assert ROOM_C <= heater.read(early) <= heater.read(late) <= target


def test_heater_that_lost_its_power_is_stopped_by_thermal_protection():
    heater = Heater(400.0, 60.0)
    heater.set_target(0.0, 40.0)
    assert heater.runs_away_at() == math.inf
    heater.lose_power(100.0)
    falls = 60.0 * math.log((40.0 - ROOM_C) / (36.0 - ROOM_C))
    assert heater.runs_away_at() == pytest.approx(100.0 + falls + 40.0)
    assert heater.read(100.0 + falls) == pytest.approx(36.0)
    heater.set_target(120.0, 0.0)
    assert heater.runs_away_at() == math.inf
