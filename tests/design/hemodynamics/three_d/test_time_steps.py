"""Steps that Windkessels need, against their equation stepped in plain Python."""

from __future__ import annotations

import math

import numpy as np
import pytest

from design.hemodynamics import PulsatileConditions, ResistanceOutlet, WindkesselOutlet
from design.hemodynamics.three_d.time_steps import MAX_ERROR, needed_steps, pulse_error
from design.hemodynamics.waveforms import Sine

PERIOD_S = 0.8


def driven(outlet: WindkesselOutlet | ResistanceOutlet) -> PulsatileConditions:
    return PulsatileConditions(1e-3, Sine(4.0, 2.0, PERIOD_S), outlet=outlet)


def stepped_swing(outlet: WindkesselOutlet, steps: int) -> float:
    """Amplitude of pressure after 200 cycles of backward differences, 2 µL/s of flow's."""
    h, now, before, last = PERIOD_S / steps, 0.0, 0.0, []
    for k in range(200 * steps):
        flow = 2.0 * math.sin(2 * math.pi * (k + 1) / steps)
        held = outlet.compliance * (2.0 * now - 0.5 * before) / h
        now, before = (flow + held) / (1.5 * outlet.compliance / h + 1.0 / outlet.distal), now
        last.append(outlet.proximal * flow + now)
    return 2.0 / steps * abs(np.fft.fft(last[-steps:])[1])


@pytest.mark.parametrize(
    "outlet", [WindkesselOutlet(1e-9, 4.0, 1.2), WindkesselOutlet(0.05, 0.5, 1.0)]
)
def test_the_estimate_is_what_stepping_gives_and_the_chosen_steps_keep_it(outlet) -> None:
    omega = 2 * np.pi / PERIOD_S
    reached = 1.0 + 1j * omega * outlet.distal * outlet.compliance
    exact = 2.0 * abs(outlet.proximal + outlet.distal / reached)
    conditions = driven(outlet)
    for steps in (12, 24, 48):
        found = stepped_swing(outlet, steps) / exact - 1.0
        assert pulse_error(conditions, steps) == pytest.approx(found, abs=2e-4)
    chosen = needed_steps(conditions)
    assert chosen > 24
    assert abs(pulse_error(conditions, chosen)) <= MAX_ERROR < abs(pulse_error(conditions, 24))
    assert abs(pulse_error(conditions, chosen - 2)) > MAX_ERROR


def test_a_compliance_that_takes_all_loses_2_percent_at_24_steps_and_needs_37() -> None:
    conditions = driven(WindkesselOutlet(1e-9, 40.0, 10.0))
    assert pulse_error(conditions, 24) == pytest.approx(-((2 * np.pi / 24) ** 2) / 3, rel=0.1)
    assert needed_steps(conditions) == pytest.approx(37, abs=1)


def test_without_a_windkessel_24_steps_stay() -> None:
    conditions = driven(ResistanceOutlet(2.0))
    assert (pulse_error(conditions, 24), needed_steps(conditions)) == (0.0, 24)
