from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Losses,
    OutletLoad,
    balance,
    flow_spread,
    solve_flow,
)
from design.network import VesselKind, VesselNetwork

FLOW = FlowConditions(4e-3, inlet_flow_ul_s=2.0)
PRESSURE = FlowConditions(4e-3, inlet_pressure_pa=5e5)
A, V, C = VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION


def ladder(rungs, seed=1):
    """A rail of arteries, a rail of veins, connections between."""
    random = np.random.default_rng(seed)
    x = np.arange(rungs + 1.0)
    top, bottom = (np.column_stack([x, 0 * x + y, 0 * x]) for y in (1.0, 0.0))
    nodes = np.concatenate([top, bottom])
    step = np.arange(rungs)
    ends = np.concatenate(
        [
            np.column_stack([step, step + 1]),
            np.column_stack([step + 2 + rungs, step + 1 + rungs]),
            np.column_stack([step + 1, step + 2 + rungs]),
        ]
    )
    kind = np.repeat([A, V, C], rungs)
    radius = np.concatenate([np.full(2 * rungs, 0.3), random.uniform(0.05, 0.12, rungs)])
    return VesselNetwork.from_segments(nodes, ends, radius, kind, 0 * kind)


@pytest.mark.parametrize("conditions", [FLOW, PRESSURE], ids=["flow", "pressure"])
@pytest.mark.parametrize("rungs", [1, 2, 7, 40])
def test_every_loop_carries_the_same(rungs, conditions):
    network = ladder(rungs)
    assert rungs == 1 or flow_spread(network, conditions) > 0.1
    balanced = balance(network, conditions)
    assert flow_spread(balanced, conditions) < 1e-9


def test_trees_and_shapes_stay():
    network = ladder(5)
    balanced = balance(network, FLOW)
    tree = np.repeat(network.kind != C, 2)
    np.testing.assert_array_equal(balanced.radius[tree], network.radius[tree])
    np.testing.assert_array_equal(balanced.points, network.points)
    ratio = balanced.radius / network.radius
    np.testing.assert_array_equal(ratio[::2], ratio[1::2])


def test_flow_drawn_backwards_counts_the_same():
    network = ladder(4)
    ends = network.vessel_nodes.copy()
    ends[-1] = ends[-1, ::-1]
    turned = VesselNetwork.from_segments(
        network.nodes, ends, network.radius[::2], network.kind, network.tree
    )
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=2.0, inlets=(0,), outlets=(5,))
    flow = solve_flow(balance(turned, conditions), conditions).flow[-4:]
    np.testing.assert_allclose(flow, [0.5, 0.5, 0.5, -0.5], rtol=1e-9)


@pytest.mark.parametrize(
    ("shares", "message"),
    [([1.0, 2.0], "2 shares for 3"), ([1.0, 0.0, 1.0], "a share is 0"), ([1, np.nan, 1], "nan")],
)
def test_impossible_shares_are_refused(shares, message):
    with pytest.raises(FlowError, match=message):
        balance(ladder(3), FLOW, shares)


def test_network_without_connections_is_refused():
    network = VesselNetwork.from_segments(
        np.array([[0.0, 0, 0], [1, 0, 0]]), [[0, 1]], [0.1], [0], [0]
    )
    with pytest.raises(FlowError, match="no vessel of kind connection"):
        balance(network, FLOW)


def test_narrowing_alone_refuses_what_needs_widening():
    """Two connections side by side, then a third: both levels between them are free."""
    nodes = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    ends = [[0, 1], [1, 2], [1, 2], [2, 3], [3, 4], [4, 5]]
    radius = np.array([0.3, 0.1, 0.08, 0.3, 0.1, 0.3])
    kind = np.array([A, C, C, A, C, V])
    chain = VesselNetwork.from_segments(nodes, ends, radius, kind, 0 * kind)
    assert flow_spread(balance(chain, FLOW, [1.0, 1.0, 2.0]), FLOW, [1.0, 1.0, 2.0]) < 1e-9
    with pytest.raises(FlowError, match=r"\d of 3 connections would have to be widened"):
        balance(chain, FLOW, [1.0, 1.0, 2.0], widen=False)


@pytest.mark.parametrize(
    "given",
    [{"fluid": Carreau()}, {"losses": Losses(junction=1.0)}, {"behind": {5: OutletLoad(1.0)}}],
)
def test_loops_are_balanced_for_newtonian_flow_alone(given):
    with pytest.raises(FlowError, match="Newtonian fluid without losses"):
        balance(ladder(4), replace(FLOW, **given))
