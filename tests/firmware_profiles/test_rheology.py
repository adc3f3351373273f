"""Needle flow, against numerically integrated velocity profiles and textbook limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles import (
    Ink,
    Needle,
    flow_ul_s,
    load,
    pressure_pa,
    wall_stress_pa,
    yield_pressure_pa,
)
from tests.slower import examples

INK, NEEDLE = load(Ink, "collagen_fresh"), load(Needle, "30g")


def ink(viscosity: float, index: float = 1.0, yield_stress: float = 0.0) -> Ink:
    return INK.model_copy(
        update={
            "viscosity_pa_s": viscosity,
            "flow_index": index,
            "yield_stress_pa": yield_stress,
        }
    )


def by_rings(fluid: Ink, stress_pa: float, bore_mm: float) -> float:
    """Flow from the shear rate at each radius, by Q = π ∫ r² γ̇ dr (no slip), midpoint rule."""
    radius, count = bore_mm / 2, 200_000
    r = (np.arange(count) + 0.5) * radius / count
    over = np.maximum(stress_pa * r / radius - fluid.yield_stress_pa, 0) / fluid.viscosity_pa_s
    return float(np.pi * np.sum(r**2 * over ** (1 / fluid.flow_index)) * radius / count)


@given(st.floats(0.1, 200), st.floats(0.15, 1.5), st.floats(0, 300), st.floats(0.05, 1.0))
@settings(max_examples=examples(40), deadline=None)
def test_flow_is_that_of_its_velocity_profile(
    consistency: float, index: float, yield_stress: float, flow: float
) -> None:
    fluid = ink(consistency, index, yield_stress)
    stress = wall_stress_pa(fluid, NEEDLE.inner_mm, flow)
    assert stress > yield_stress
    assert by_rings(fluid, stress, NEEDLE.inner_mm) == pytest.approx(flow, rel=1e-3)


@given(st.floats(0.01, 500), st.floats(0.06, 1.5), st.floats(0, 1000), st.floats(1e-5, 100))
@settings(max_examples=examples(200), deadline=None)
def test_pressure_and_flow_are_each_other_s_inverse(
    consistency: float, index: float, yield_stress: float, flow: float
) -> None:
    fluid = ink(consistency, index, yield_stress)
    pressure = pressure_pa(fluid, NEEDLE, flow)
    assert flow_ul_s(fluid, NEEDLE, pressure * (1 + 1e-12)) >= flow * (1 - 1e-6)
    assert flow_ul_s(fluid, NEEDLE, pressure * (1 - 1e-12)) <= flow * (1 + 1e-6)


def test_bingham_is_buckingham_and_reiner_s() -> None:
    plastic, pressure = ink(2.0, 1.0, 50.0), 60e3
    phi = yield_pressure_pa(plastic, NEEDLE) / pressure
    newtonian = math.pi * 0.16**4 * pressure / (128 * 2.0 * 12.7)
    expected = newtonian * (1 - 4 / 3 * phi + phi**4 / 3)
    assert flow_ul_s(plastic, NEEDLE, pressure) == pytest.approx(expected)


def test_nothing_flows_below_what_the_yield_stress_holds() -> None:
    fluid = ink(20.0, 0.5, 80.0)
    held = yield_pressure_pa(fluid, NEEDLE)
    assert held == pytest.approx(4 * 80 * 12.7 / 0.16)
    assert flow_ul_s(fluid, NEEDLE, held) == 0
    assert flow_ul_s(fluid, NEEDLE, 1.01 * held) > 0
    assert pressure_pa(fluid, NEEDLE, 0.0) == pytest.approx(held)
    assert yield_pressure_pa(ink(20.0), NEEDLE) == 0
