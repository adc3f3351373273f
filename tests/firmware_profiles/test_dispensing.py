"""Choice of a pneumatic head's flow: weighed value if applicable, else from viscosity."""

from __future__ import annotations

from typing import Any

import pytest

from firmware_profiles import (
    Ink,
    MeasuredFlow,
    Needle,
    Pneumatic,
    Printer,
    ProfileError,
    flow_ul_s,
    load,
    steady_flow,
)

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
