"""Pressure losses at stenoses and bifurcations."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Losses,
    Stenosis,
    flow_summary,
    solve_flow,
    vessel_resistance,
)
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree

DENSITY = 1.06e-3
FORK = network_of(
    [[0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0]], [(0, 1), (1, 2), (3, 1)], [0.5, 0.4, 0.3]
)


def test_a_stenosis_takes_what_young_and_tsai_found() -> None:
    network = network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 1.0)
    flow, share, length = 400.0, 0.5, 3.0
    losses = Losses(stenoses=(Stenosis(0, share, length),))
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=flow, losses=losses)
    speed = flow / np.pi
    # K_v = 32 (0.83 L_s + 1.64 D_s)/D₀ (A₀/A_s)², of Δp = K_v μ U/D₀.
    viscous = 32 * (0.83 * length + 1.64 * 1.0) / 2 * 16 * VISCOSITY * speed / 2
    inertial = 1.52 / 2 * (4 - 1) ** 2 * DENSITY * speed**2
    rest = 8 * VISCOSITY * (20 - length) * flow / np.pi
    found = solve_flow(network, conditions)
    assert found.pressure[0] == pytest.approx(viscous + inertial + rest, rel=1e-12)
    assert found.loss is not None
    assert found.loss[0] == pytest.approx(inertial, rel=1e-12)


def test_a_junction_takes_k_heads_of_each_vessel_that_leaves_it() -> None:
    conditions = FlowConditions(
        VISCOSITY, inlet_flow_ul_s=50.0, inlets=(0,), outlets=(2, 3), losses=Losses(junction=0.8)
    )
    found = solve_flow(FORK, conditions)
    first, last = FORK.vessel_nodes.T
    viscous = vessel_resistance(FORK, VISCOSITY) * found.flow
    head = 0.8 * DENSITY / 2 * found.velocity * np.abs(found.velocity) * [0, 1, 1]
    drop = found.pressure[first] - found.pressure[last]
    assert found.flow[2] < 0 < found.flow[1]
    assert drop == pytest.approx(viscous + head, rel=1e-9)


@pytest.mark.parametrize("pressure", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("fluid", [None, Carreau()])
def test_strong_losses_settle_and_balance(pressure: float, fluid: Carreau | None) -> None:
    network = random_tree(5, 40, 0.5)
    losses = Losses(junction=20.0, stenoses=(Stenosis(0, 0.2, 0.01), Stenosis(7, 0.5, 0.01)))
    conditions = FlowConditions(VISCOSITY, inlet_pressure_pa=pressure, losses=losses, fluid=fluid)
    told = flow_summary(network, solve_flow(network, conditions), conditions)
    assert told["mass_imbalance"] < 1e-12
    assert told["energy_imbalance"] < 1e-9


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Stenosis(0, 1.2, 1.0), "0.1 to 1"),
        (lambda: Stenosis(0, 0.5, -1.0), "length above 0"),
        (lambda: Losses(junction=-1.0), "0 to 100"),
        (lambda: _solved(Stenosis(9, 0.5, 1.0)), "has 0 to 2"),
        (lambda: _solved(Stenosis(0, 0.5, 9.0)), "the vessel 4 mm"),
    ],
)
def test_impossible_losses_are_refused(make: object, words: str) -> None:
    with pytest.raises(FlowError, match=words):
        make()  # type: ignore[operator]


def _solved(stenosis: Stenosis) -> object:
    losses = Losses(stenoses=(stenosis,))
    return solve_flow(
        FORK,
        FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0, inlets=(0,), outlets=(2, 3), losses=losses),
    )
