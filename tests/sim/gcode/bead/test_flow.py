"""Needle outflow, against the exponential law; volumes conserved."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware_profiles import Ink, Needle, load, yield_pressure_pa
from sim.gcode.bead import Nozzle, Pieces, nozzle_flow, nozzle_of

LAG = 0.4


def pieces(durations: list[float], rates: list[float], jumps: dict[int, float] | None = None):
    """Stretches of time with a constant plunger flow, µL/s, the needle going 1 mm/s."""
    time = np.concatenate([[0.0], np.cumsum(durations)])
    place = np.column_stack([time, np.zeros((len(time), 2))])
    jump = np.zeros(len(durations))
    for row, volume in (jumps or {}).items():
        jump[row] = volume
    push = np.array(rates) * np.array(durations)
    return Pieces(place[:-1], place[1:], time, push, jump, np.arange(len(durations)))


def test_a_step_of_flow_is_followed_exponentially() -> None:
    found = nozzle_flow(pieces([0.05] * 40, [2.0] * 40), Nozzle(LAG))
    time = 0.05 * np.arange(1, 41)
    out = 2.0 * (time - LAG * (1 - np.exp(-time / LAG)))
    np.testing.assert_allclose(np.cumsum(found.out_ul), out, rtol=1e-12)
    np.testing.assert_allclose(found.held_ul, 2.0 * LAG * (1 - np.exp(-time / LAG)), rtol=1e-12)


@pytest.mark.parametrize("nozzle", [Nozzle(), Nozzle(LAG), Nozzle(LAG, 5e4, 3e4)])
def test_ink_is_neither_made_nor_lost(nozzle: Nozzle) -> None:
    random = np.random.default_rng(1)
    given = pieces(
        random.uniform(0, 1, 300).tolist(), random.normal(0.3, 1, 300).tolist(), {7: 0.3, 90: -0.2}
    )
    found = nozzle_flow(given, nozzle)
    pushed = float((given.push_ul + given.jump_ul).sum())
    stays = 0.0 if nozzle.lag_s == 0 else float(found.held_ul[-1]) - found.start_ul
    assert pushed == pytest.approx(float(found.out_ul.sum()) + stays, abs=1e-12)
    assert (found.laid_ul >= 0).all()
    # What is laid is what came out beyond what had been out: the highest of the running sum.
    assert found.laid_ul.sum() == pytest.approx(max(0.0, np.cumsum(found.out_ul).max()))


def test_an_advance_of_the_lag_cancels_it() -> None:
    rates = [1.0, 3.0, 0.5, 0.0]
    jumps = {0: LAG * 1.0, 1: LAG * 2.0, 2: -LAG * 2.5, 3: -LAG * 0.5}
    found = nozzle_flow(pieces([0.7] * 4, rates, jumps), Nozzle(LAG))
    np.testing.assert_allclose(found.out_ul / 0.7, rates, atol=1e-12)
    without = nozzle_flow(pieces([0.7] * 4, rates), Nozzle(LAG))
    assert abs(without.out_ul / 0.7 - rates).max() > 0.3


def test_flow_goes_on_after_a_stop_and_ends_at_zero() -> None:
    found = nozzle_flow(pieces([20.0, 100.0], [1.5, 0.0]), Nozzle(LAG))
    assert found.out_ul[1] == pytest.approx(1.5 * LAG)
    assert found.held_ul[1] == pytest.approx(0.0, abs=1e-12)


def test_a_yield_stress_stays_behind_the_needle() -> None:
    ink = load(Ink, "collagen_fresh").model_copy(update={"yield_stress_pa": 120.0})
    needle = load(Needle, "30g")
    nozzle = nozzle_of(ink, needle, LAG, 0.5)
    held = 4 * 120.0 * needle.length_mm / needle.inner_mm
    assert yield_pressure_pa(ink, needle) == pytest.approx(held)
    found = nozzle_flow(pieces([20.0, 100.0], [0.5, 0.0]), nozzle)
    assert found.held_ul[1] * nozzle.resistance_pa_s_ul / LAG == pytest.approx(held)
    # Relieved by less than twice that volume, nothing is drawn in; primed again, it flows at once.
    relief = nozzle.held_ul
    again = nozzle_flow(
        pieces([20, 100, 0.1, 5, 0.1, 50], [0.5, 0, -relief / 0.1, 0, relief / 0.1, 0]), nozzle
    )
    np.testing.assert_allclose(again.out_ul[2:], 0.0, atol=1e-9)


def test_a_retraction_stops_the_flow_when_the_pressure_is_gone() -> None:
    flow, pull = 1.0, 4.0
    takes = LAG * math.log(1 + flow / pull)
    found = nozzle_flow(pieces([50.0, takes, 0.5], [flow, -pull, 0.0]), Nozzle(LAG))
    assert found.held_ul[1] == pytest.approx(0.0, abs=1e-12)
    assert found.out_ul[1] == pytest.approx(LAG * flow - pull * takes)
    assert found.out_ul[2] == pytest.approx(0.0, abs=1e-12)
