"""Flow of a print scaled up or down from its design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.hemodynamics import (
    FlowConditions,
    flow_summary,
    same_shear_conditions,
    scaled_flow,
    scaled_network,
    solve_flow,
)
from design.vasculature import planar_four_vessel

WATER = FlowConditions(viscosity_pa_s=1e-3, inlet_flow_ul_s=4.0, outlet_pressure_pa=200.0)


@pytest.mark.parametrize("factor", [0.3, 4.0])
def test_same_shear_and_pressure_in_the_scaled_network(factor):
    network = planar_four_vessel()
    design = solve_flow(network, WATER)
    large = scaled_network(network, factor)
    print_ = solve_flow(large, same_shear_conditions(WATER, factor))
    assert print_.wall_shear == pytest.approx(design.wall_shear, rel=1e-9)
    assert print_.pressure == pytest.approx(design.pressure, rel=1e-9)
    assert np.allclose(large.radius, factor * network.radius)


def test_both_ways_of_scaling_are_solutions_of_the_scaled_network():
    network, factor = planar_four_vessel(), 2.5
    summary = flow_summary(network, solve_flow(network, WATER), WATER)
    large = scaled_network(network, factor)
    for name, said in scaled_flow(summary, factor).items():
        if name == "design":
            continue
        driven = replace(WATER, inlet_flow_ul_s=said["inflow_ml_min"] * 1e3 / 60)
        found = flow_summary(large, solve_flow(large, driven), driven)
        assert found["pressure_drop_mmhg"] == pytest.approx(said["pressure_drop_mmhg"], rel=1e-9)
        if name == "same_reynolds":
            key = next(key for key in summary if key.startswith("reynolds"))
            assert found[key] == pytest.approx(summary[key], rel=1e-9)


def test_outlet_flows_scale_and_pressures_stay():
    driven = FlowConditions(viscosity_pa_s=1e-3, inlet_pressure_pa=900.0, outlet_flow_ul_s={3: 2.0})
    scaled = same_shear_conditions(driven, 2.0)
    assert scaled.outlet_flow_ul_s == {3: 16.0}
    assert scaled.inlet_pressure_pa == 900.0
    assert same_shear_conditions(driven, 1.0) is driven
