"""Flow problems without a unique solution: refused with the reason."""

from __future__ import annotations

import math

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import FlowConditions, OutletLoad, PowerLaw, solve_flow, vessel_resistance
from tests.design.hemodynamics.networks import VISCOSITY, network_of

LINE = network_of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1), (1, 2)], 0.2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "either inlet_flow_ul_s or inlet_pressure_pa"),
        ({"inlet_flow_ul_s": 1.0, "inlet_pressure_pa": 1.0}, "and not both"),
        ({"inlet_flow_ul_s": math.nan}, "inlet_flow_ul_s is nan"),
        ({"inlet_pressure_pa": 1.0, "outlet_pressure_pa": math.inf}, "outlet_pressure_pa is inf"),
        ({"inlet_pressure_pa": 1.0, "outlet_flow_ul_s": {2: math.nan}}, "node 2 is nan"),
    ],
)
def test_conditions_must_be_whole(given: dict[str, float], message: str) -> None:
    with pytest.raises(FlowError, match=message):
        FlowConditions(VISCOSITY, **given)


@pytest.mark.parametrize("viscosity", [0.0, -1.0, math.nan])
def test_viscosity_must_be_above_zero(viscosity: float) -> None:
    with pytest.raises(FlowError, match="viscosity"):
        FlowConditions(viscosity, inlet_flow_ul_s=1.0)


def test_a_part_without_outlet_is_named() -> None:
    nodes = [[0, 0, 0], [1, 0, 0], [0, 5, 0], [1, 5, 0], [0.5, 6, 0]]
    network = network_of(nodes, [(0, 1), (2, 3), (3, 4), (4, 3)], 0.2)
    with pytest.raises(FlowError, match=r"vessel 1 .*isolated part without outlet \(3 such"):
        solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0))


def test_flows_at_every_end_leave_the_pressure_open() -> None:
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0, outlet_flow_ul_s={2: 1.0})
    with pytest.raises(FlowError, match="no pressure is determined"):
        solve_flow(LINE, conditions)


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        (FlowConditions(VISCOSITY, 1.0, outlets=()), "no outlet"),
        (FlowConditions(VISCOSITY, 1.0, inlets=(7,)), "inlet 7 isn't a node"),
        (FlowConditions(VISCOSITY, 1.0, inlets=(0, 2)), "node 2 is both"),
        (FlowConditions(VISCOSITY, 1.0, outlet_flow_ul_s={1: 0.5}), "node 1 isn't one of the out"),
    ],
)
def test_ends_must_be_nodes_of_the_network(conditions: FlowConditions, message: str) -> None:
    with pytest.raises(FlowError, match=message):
        solve_flow(LINE, conditions)


def test_a_resistance_behind_an_outlet_is_as_a_vessel_more() -> None:
    """Two outlets behind 1:2; and pressures beyond, one of them the lowest."""
    fork = network_of([[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0]], [(0, 1), (1, 2), (1, 3)], 0.3)
    r = vessel_resistance(fork, VISCOSITY)
    behind = {2: OutletLoad(5.0, 30.0), 3: OutletLoad(10.0, -10.0)}
    for fluid in (None, PowerLaw(VISCOSITY, 1.0000001)):
        found = solve_flow(
            fork, FlowConditions(VISCOSITY, inlet_pressure_pa=100.0, behind=behind, fluid=fluid)
        )
        g = 1 / np.array([r[0], r[1] + 5.0, r[2] + 10.0])
        middle = g @ [100.0, 30.0, -10.0] / g.sum()
        flow = g * [100.0 - middle, middle - 30.0, middle + 10.0]
        assert found.flow == pytest.approx(flow, rel=1e-5)
        assert found.pressure[2] == pytest.approx(30.0 + 5.0 * flow[1], rel=1e-5)


def test_named_ends_take_the_place_of_the_designed_ones() -> None:
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0, inlets=(2,), outlets=(0,))
    assert solve_flow(LINE, conditions).flow.tolist() == pytest.approx([-1.0, -1.0], rel=1e-14)
