"""Cross-section models of printed lines: width from area, and back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles import (
    Ink,
    MeasuredFlow,
    Needle,
    Pneumatic,
    Printer,
    ProfileError,
    flow_ul_s,
    load,
    pressure_pa,
    steady_flow,
    wall_stress_pa,
    yield_pressure_pa,
)
from firmware_profiles.materials.bead import BeadSection
from tests.slower import examples

MODELS = ("rounded", "rectangle", "ellipse", 12.5)


@pytest.mark.parametrize("model", MODELS)
@given(area=st.floats(1e-6, 2.0), height=st.floats(0.01, 0.5))
def test_area_is_the_inverse_of_width(model, area, height):
    bead = BeadSection(model)
    assert bead.area(bead.width(np.array([area]), height), height) == pytest.approx(area)


def test_a_rounded_line_is_a_band_between_half_circles_and_round_where_it_is_small():
    height = 0.06
    band = (0.15 - height) * height + math.pi / 4 * height**2
    small = math.pi / 4 * 0.03**2
    found = BeadSection().width(np.array([band, small]), height)
    assert found == pytest.approx([0.15, 0.03])


# Choice of a pneumatic head's flow: weighed value if applicable, else from viscosity.

INK, NEEDLE = load(Ink, "collagen_fresh"), load(Needle, "27g")


def head(**changes: Any) -> Pneumatic:
    found = load(Printer, "pneumatic_marlin").pneumatic
    assert found is not None
    said = MeasuredFlow(flow_ul_s=0.4, pressure_kpa=80, ink=INK.name, needle=NEEDLE.name)
    return found.model_copy(update={"measured": said, **changes})


def test_a_weighed_flow_is_believed_as_it_is() -> None:
    factor = INK.model_copy(update={"flow_factor": 0.7})
    for ink in (INK, factor):  # the factor is of what is foreseen
        flow = steady_flow(head(), ink, NEEDLE)
        assert (flow.ul_s, flow.measured) == (0.4, True)


@pytest.mark.parametrize(
    ("changes", "ink", "needle"),
    [
        ({"measured": None}, INK, NEEDLE),
        ({"pressure_kpa": 81.0}, INK, NEEDLE),
        ({}, load(Ink, "alginate_fresh"), NEEDLE),
        ({}, INK, load(Needle, "30g")),
    ],
)
def test_else_it_is_the_viscosity_s(changes: dict[str, Any], ink: Ink, needle: Needle) -> None:
    thin = ink.model_copy(update={"flow_factor": 0.9})
    set_to = head(**changes)
    flow = steady_flow(set_to, thin, needle)
    assert not flow.measured
    assert flow.ul_s == pytest.approx(0.9 * flow_ul_s(thin, needle, set_to.pressure_kpa * 1e3))


def test_a_pressure_below_the_yield_stress_is_refused_with_what_it_takes() -> None:
    stiff = INK.model_copy(update={"yield_stress_pa": 400.0})
    with pytest.raises(ProfileError, match=r"holds 96\.\d+ kPa"):
        steady_flow(head(measured=None), stiff, NEEDLE)


# Needle flow, against numerically integrated velocity profiles and textbook limits.

INK_RHEOLOGY, NEEDLE_RHEOLOGY = load(Ink, "collagen_fresh"), load(Needle, "30g")


def ink(viscosity: float, index: float = 1.0, yield_stress: float = 0.0) -> Ink:
    return INK_RHEOLOGY.model_copy(
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
def test_flow_is_that_of_its_velocity_profile(consistency, index, yield_stress, flow):
    fluid = ink(consistency, index, yield_stress)
    stress = wall_stress_pa(fluid, NEEDLE_RHEOLOGY.inner_mm, flow)
    assert stress > yield_stress
    assert by_rings(fluid, stress, NEEDLE_RHEOLOGY.inner_mm) == pytest.approx(flow, rel=1e-3)


@given(st.floats(0.01, 500), st.floats(0.06, 1.5), st.floats(0, 1000), st.floats(1e-5, 100))
@settings(max_examples=examples(200), deadline=None)
def test_pressure_and_flow_are_each_other_s_inverse(consistency, index, yield_stress, flow):
    fluid = ink(consistency, index, yield_stress)
    pressure = pressure_pa(fluid, NEEDLE_RHEOLOGY, flow)
    assert flow_ul_s(fluid, NEEDLE_RHEOLOGY, pressure * (1 + 1e-12)) >= flow * (1 - 1e-6)
    assert flow_ul_s(fluid, NEEDLE_RHEOLOGY, pressure * (1 - 1e-12)) <= flow * (1 + 1e-6)


def test_bingham_is_buckingham_and_reiner_s() -> None:
    plastic, pressure = ink(2.0, 1.0, 50.0), 60e3
    phi = yield_pressure_pa(plastic, NEEDLE_RHEOLOGY) / pressure
    newtonian = math.pi * 0.16**4 * pressure / (128 * 2.0 * 12.7)
    expected = newtonian * (1 - 4 / 3 * phi + phi**4 / 3)
    assert flow_ul_s(plastic, NEEDLE_RHEOLOGY, pressure) == pytest.approx(expected)


def test_nothing_flows_below_what_the_yield_stress_holds() -> None:
    fluid = ink(20.0, 0.5, 80.0)
    held = yield_pressure_pa(fluid, NEEDLE_RHEOLOGY)
    assert held == pytest.approx(4 * 80 * 12.7 / 0.16)
    assert flow_ul_s(fluid, NEEDLE_RHEOLOGY, held) == 0
    assert flow_ul_s(fluid, NEEDLE_RHEOLOGY, 1.01 * held) > 0
    assert pressure_pa(fluid, NEEDLE_RHEOLOGY, 0.0) == pytest.approx(held)
    assert yield_pressure_pa(ink(20.0), NEEDLE_RHEOLOGY) == 0
