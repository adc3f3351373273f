"""Sensitivity of flows to radii, against finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import FlowConditions, Losses, OutletLoad, PowerLaw, solve_flow
from design.hemodynamics.zero_d.sensitivity import flow_and_sensitivity
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import network_of

VISCOSITY = 1e-3


def _mesh_of_two_loops() -> VesselNetwork:
    """Two inlets, two outlets, a bridge, a taper."""
    nodes = [[0, 0, 0], [0, 2, 0], [1, 0, 0], [1, 2, 0], [2, 0, 0], [2, 2, 0], [4, 0, 0], [4, 2, 0]]
    ends = [(0, 2), (1, 3), (2, 3), (2, 4), (3, 5), (4, 5), (4, 6), (5, 7)]
    radius = [0.5, 0.4, 0.2, 0.3, 0.35, 0.25, 0.3, 0.2]
    network = network_of([[float(x) for x in row] for row in nodes], ends, radius)
    tapered = network.radius.copy()
    tapered[7] *= 0.7
    return replace(network, radius=tapered)


@pytest.mark.parametrize(
    "conditions",
    [
        FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0),
        FlowConditions(VISCOSITY, inlet_pressure_pa=50.0, outlet_pressure_pa=10.0),
        FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0, behind={6: OutletLoad(2.0, 5.0)}),
        FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0, outlet_flow_ul_s={6: 1.0}),
    ],
)
def test_derivatives_are_those_of_central_differences(conditions: FlowConditions) -> None:
    network, step = _mesh_of_two_loops(), 1e-5
    vessels = np.array([0, 2, 3, 7])
    flow, slope = flow_and_sensitivity(network, conditions, vessels)
    assert flow == pytest.approx(solve_flow(network, conditions).flow, rel=1e-12)
    owner = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    for column, vessel in enumerate(vessels):
        up, down = (
            solve_flow(
                replace(network, radius=network.radius * np.exp(sign * step * (owner == vessel))),
                conditions,
            ).flow
            for sign in (1.0, -1.0)
        )
        assert slope[:, column] == pytest.approx((up - down) / (2.0 * step), abs=1e-7)


def test_nonlinear_problems_are_refused() -> None:
    network = _mesh_of_two_loops()
    for more in ({"fluid": PowerLaw(0.01, 0.6)}, {"losses": Losses(junction=1.0)}):
        conditions = replace(FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0), **more)
        with pytest.raises(FlowError, match="Newtonian flow without losses"):
            flow_and_sensitivity(network, conditions, np.array([0]))
