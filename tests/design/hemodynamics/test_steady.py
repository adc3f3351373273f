"""Steady 0D flow: closed forms, a dense oracle, mass conservation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from design.errors import FlowError
from design.hemodynamics import (
    FlowConditions,
    FlowSolution,
    PulsatileConditions,
    Supply,
    node_inflow,
    same_shear_conditions,
    solve_flow,
    solve_pulsatile,
    vessel_resistance,
)
from design.hemodynamics.waveforms import Sine
from design.network import VesselNetwork
from design.units import WATER_DENSITY
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree
from tests.slower import examples


def _imbalance(network: VesselNetwork, solution: FlowSolution, ends: set[int]) -> float:
    """Greatest net flow at an inner node over the flow through it, node by node."""
    worst = 0.0
    for node in set(range(len(network.nodes))) - ends:
        signed = [
            (1 if nodes[0] == node else -1) * flow
            for nodes, flow in zip(network.vessel_nodes.tolist(), solution.flow, strict=True)
            if node in nodes
        ]
        worst = max(worst, abs(sum(signed)) / sum(map(abs, signed)))
    return worst


def test_a_wheatstone_bridge_is_as_by_hand() -> None:
    """Four arms of resistances 1, 2, 3, 4 and a bridge of 5.

    One unit of pressure over the whole; the two inner nodes' equations:
    p₁ (1 + 1/3 + 1/5) - p₂/5 = 1, p₂ (1/2 + 1/4 + 1/5) - p₁/5 = 1/2.
    """
    arms = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    corner = 1 / np.sqrt(2)
    nodes = [[0, 0, 0], [corner, corner, 0], [corner, -corner, 0], [2 * corner, 0, 0]]
    ends = [(0, 1), (0, 2), (1, 3), (2, 3), (1, 2)]
    lengths = np.array([1, 1, 1, 1, 2 * corner])
    radius = (8 * VISCOSITY * lengths / (np.pi * arms)) ** 0.25
    network = network_of(nodes, ends, radius.tolist())
    assert vessel_resistance(network, VISCOSITY) == pytest.approx(arms)

    a, b, c = 1 + 1 / 3 + 1 / 5, 1 / 5, 1 / 2 + 1 / 4 + 1 / 5
    p1 = (c * 1.0 + b * 0.5) / (a * c - b * b)
    p2 = (a * 0.5 + b * 1.0) / (a * c - b * b)
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_pressure_pa=1.0))
    assert solution.pressure == pytest.approx([1.0, p1, p2, 0.0], rel=1e-12)
    by_hand = [1 - p1, (1 - p2) / 2, p1 / 3, p2 / 4, (p1 - p2) / 5]
    assert solution.flow == pytest.approx(by_hand, rel=1e-12)


def test_shear_and_velocity_are_those_of_the_flow() -> None:
    network = network_of([[0, 0, 0], [5, 0, 0]], [(0, 1)], 0.2)
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0))
    assert solution.velocity[0] == pytest.approx(3.0 / (np.pi * 0.04))
    # Force balance: the drop over the lumen's area is the shear over its wall.
    drop = solution.pressure[0] - solution.pressure[1]
    assert solution.wall_shear[0] * 2 * np.pi * 0.2 * 5 == pytest.approx(drop * np.pi * 0.04)


@settings(max_examples=examples(60), deadline=None)
@given(seed=st.integers(0, 2**32 - 1), vessels=st.integers(1, 60), spread=st.floats(0.0, 2.0))
def test_random_trees_conserve_mass_and_divide_by_what_lies_below(seed, vessels, spread):
    network = random_tree(seed, vessels, spread)
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=2.0, outlet_pressure_pa=500.0)
    solution = solve_flow(network, conditions)
    ends = {0, *network.outlets().tolist()}
    assert _imbalance(network, solution, ends) <= 1e-12
    inflow = node_inflow(network, solution.flow)
    assert inflow[0] == pytest.approx(2.0, rel=1e-12)
    assert inflow[network.outlets()].sum() == pytest.approx(-2.0, rel=1e-12)
    assert solution.flow == pytest.approx(_tree_oracle(network, 2.0), rel=1e-11, abs=1e-300)


def _tree_oracle(network: VesselNetwork, total: float) -> np.ndarray:
    """Equal outlet pressures: flow divides by the conductance below, from the leaves up."""
    resistance = vessel_resistance(network, VISCOSITY)
    children: dict[int, list[int]] = {}
    for vessel, (first, _) in enumerate(network.vessel_nodes.tolist()):
        children.setdefault(first, []).append(vessel)

    def below(vessel: int) -> float:
        """Resistance of a vessel and all that hangs on it."""
        branches = children.get(int(network.vessel_nodes[vessel, 1]), [])
        rest = 1 / sum(1 / below(branch) for branch in branches) if branches else 0.0
        return float(resistance[vessel]) + rest

    flow = np.zeros(network.vessel_count)

    def share(node: int, amount: float) -> None:
        weights = {branch: 1 / below(branch) for branch in children.get(node, [])}
        for branch, weight in weights.items():
            flow[branch] = amount * weight / sum(weights.values())
            share(int(network.vessel_nodes[branch, 1]), flow[branch])

    share(0, total)
    return flow


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_graphs_with_loops_agree_with_a_dense_solution(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tree = random_tree(seed, 25, 0.7)
    extra = rng.integers(1, 25, (12, 2))
    extra = np.sort(extra[extra[:, 0] != extra[:, 1]], axis=1)
    network = VesselNetwork.from_segments(
        tree.nodes,
        np.concatenate([tree.vessel_nodes, extra]),
        np.exp(rng.normal(size=25 + len(extra))),
        np.zeros(25 + len(extra)),
        np.zeros(25 + len(extra)),
    )
    outlets = network.outlets()
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_pressure_pa=1000.0))
    conductance = np.diag(1 / vessel_resistance(network, VISCOSITY))
    incidence = np.zeros((network.vessel_count, len(network.nodes)))
    incidence[np.arange(network.vessel_count), network.vessel_nodes[:, 0]] = 1
    incidence[np.arange(network.vessel_count), network.vessel_nodes[:, 1]] -= 1
    matrix = incidence.T @ conductance @ incidence
    right = np.zeros(len(network.nodes))
    for node, value in [(0, 1000.0), *((node, 0.0) for node in outlets)]:
        matrix[node], right[node] = 0.0, value
        matrix[node, node] = 1.0
    pressure = np.linalg.solve(matrix, right)
    assert solution.pressure == pytest.approx(pressure, rel=1e-8, abs=1e-8)
    assert _imbalance(network, solution, {0, *outlets.tolist()}) <= 1e-12


def test_mass_is_conserved_where_pressure_differences_drown_in_the_pressure() -> None:
    """A wide vessel's drop is 1e-16 of the pressure: p₀ - p₁ alone has no digit left."""
    nodes = [[0, 0, 0], [20, 0, 0], [20.01, 0, 0], [40, 1, 0], [40, -1, 0]]
    network = network_of(nodes, [(0, 1), (1, 2), (2, 3), (2, 4)], [0.01, 10.0, 0.01, 0.01])
    solution = solve_flow(
        network, FlowConditions(VISCOSITY, inlet_pressure_pa=1e4, outlet_pressure_pa=9e3)
    )
    assert _imbalance(network, solution, {0, 3, 4}) <= 1e-12


def test_mass_is_conserved_round_a_wide_loop_between_thin_vessels() -> None:
    """The same in a loop, which no elimination of branches takes away."""
    nodes = [[0, 0, 0], [20, 0, 0], [20.5, 1, 0], [20.5, -1, 0], [40, 1, 0], [40, -1, 0]]
    ends = [(0, 1), (1, 2), (1, 3), (2, 3), (2, 4), (3, 5)]
    network = network_of(nodes, ends, [0.01, 2.0, 2.0, 2.0, 0.01, 0.02])
    solution = solve_flow(
        network, FlowConditions(VISCOSITY, inlet_pressure_pa=1e4, outlet_pressure_pa=9e3)
    )
    assert _imbalance(network, solution, {0, 4, 5}) <= 1e-12


def test_several_inlets_on_one_supply_share_its_pressure() -> None:
    nodes = [[0, 0, 0], [0, 2, 0], [1, 1, 0], [2, 1, 0]]
    network = network_of(nodes, [(0, 2), (1, 2), (2, 3)], [0.2, 0.4, 0.3])
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0))
    assert solution.pressure[0] == solution.pressure[1]
    assert solution.flow[:2].sum() == pytest.approx(1.0, rel=1e-13)
    assert solution.flow[1] / solution.flow[0] == pytest.approx(16.0, rel=1e-12)


def test_outlets_take_the_flows_they_are_given() -> None:
    network = network_of(
        [[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0]], [(0, 1), (1, 2), (1, 3)], 0.2
    )
    conditions = FlowConditions(VISCOSITY, inlet_pressure_pa=50.0, outlet_flow_ul_s={2: 1, 3: 2})
    solution = solve_flow(network, conditions)
    assert solution.flow == pytest.approx([3.0, 1.0, 2.0], rel=1e-13)
    one = replace(conditions, outlet_flow_ul_s={2: 1.0})
    assert solve_flow(network, one).pressure[3] == 0.0


def test_the_numbering_of_vessels_and_nodes_changes_nothing() -> None:
    network = random_tree(3, 40)
    rng = np.random.default_rng(0)
    node, vessel = rng.permutation(41), rng.permutation(40)
    nodes = np.empty_like(network.nodes)
    nodes[node] = network.nodes
    other = VesselNetwork.from_segments(
        nodes,
        node[network.vessel_nodes[vessel]],
        network.mean_radius()[vessel],
        network.kind[vessel],
        network.tree[vessel],
    )
    conditions = FlowConditions(VISCOSITY, inlet_pressure_pa=100.0)
    before, after = solve_flow(network, conditions), solve_flow(other, conditions)
    assert after.flow == pytest.approx(before.flow[vessel], rel=1e-10)
    assert after.pressure[node] == pytest.approx(before.pressure, rel=1e-10, abs=1e-12)


# Resistance against Poiseuille's law, and the taper's closed form against quadrature.


def test_a_straight_vessel_has_poiseuilles_resistance() -> None:
    network = network_of([[0, 0, 0], [0, 3, 4]], [(0, 1)], 0.25)
    expected = 8 * VISCOSITY * 5.0 / (np.pi * 0.25**4)
    assert vessel_resistance(network, VISCOSITY) == pytest.approx([expected], rel=1e-14)


@pytest.mark.parametrize(("first", "last"), [(0.5, 0.1), (0.1, 0.5), (0.3, 0.29999)])
def test_a_taper_has_the_integral_of_one_over_r4(first: float, last: float) -> None:
    network = VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [7, 0, 0]]),
        vessel_nodes=np.array([[0, 1]]),
        kind=np.array([0]),
        tree=np.array([0]),
        offset=np.array([0, 2]),
        points=np.array([[0.0, 0, 0], [7, 0, 0]]),
        radius=np.array([first, last]),
    )
    integral = quad(lambda s: (first + (last - first) * s / 7) ** -4, 0, 7, epsrel=1e-12)[0]
    expected = 8 * VISCOSITY / np.pi * integral
    assert vessel_resistance(network, VISCOSITY)[0] == pytest.approx(expected, rel=1e-10)


def test_pieces_of_a_polyline_add_up() -> None:
    network = VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [1, 2, 0]]),
        vessel_nodes=np.array([[0, 1]]),
        kind=np.array([0]),
        tree=np.array([0]),
        offset=np.array([0, 3]),
        points=np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]]),
        radius=np.full(3, 0.2),
    )
    expected = 8 * VISCOSITY * 3.0 / (np.pi * 0.2**4)
    assert vessel_resistance(network, VISCOSITY)[0] == pytest.approx(expected, rel=1e-14)


def test_a_vessel_of_zero_length_is_refused() -> None:
    network = network_of([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [(0, 1), (1, 2)], 0.2)
    with pytest.raises(FlowError, match="vessel 1 has zero length"):
        vessel_resistance(network, VISCOSITY)


# Inlets on supplies of their own: flows by hand, and what can't be.


def tubes() -> VesselNetwork:
    """Two unconnected parts: a tube, and two that join into one."""
    nodes = np.array([[0, 0, 0], [9, 0, 0], [0, 5, 0], [0, 8, 0], [5, 6, 0], [9, 6, 0]], float)
    ends = np.array([[0, 1], [2, 4], [3, 4], [4, 5]])
    none = np.zeros(4, dtype=np.int64)
    return VesselNetwork.from_segments(nodes, ends, np.full(4, 0.3), none, none)


OWN = (Supply((2, 3), 6.0),)


def test_each_supply_gives_its_own_flow() -> None:
    net = tubes()
    found = solve_flow(net, FlowConditions(1e-3, inlet_flow_ul_s=4.0, supplies=OWN))
    np.testing.assert_allclose(found.flow[[0, 3]], [4.0, 6.0])
    assert found.pressure[2] == pytest.approx(found.pressure[3])
    assert found.pressure[0] != pytest.approx(found.pressure[2])
    wider = same_shear_conditions(FlowConditions(1e-3, inlet_flow_ul_s=4.0, supplies=OWN), 2.0)
    assert wider.supplies[0].flow_ul_s == 48.0


def test_a_pulse_leaves_other_supplies_steady() -> None:
    net = tubes()
    driven = PulsatileConditions(1e-3, Sine(4.0, 1.0, 1.0), supplies=OWN)
    flow = solve_pulsatile(net, driven).flow_in
    np.testing.assert_allclose(flow[0].real[[0, 3]], [4.0, 6.0])
    assert abs(flow[1, 0]) == pytest.approx(1.0)
    np.testing.assert_allclose(flow[1, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("supplies", "said"),
    [
        ((Supply((1,), 1.0),), "node 1 has a supply of its own and isn't an inlet"),
        ((Supply((2,), 1.0), Supply((2, 3), 1.0)), "inlet 2 hangs on two supplies"),
        ((Supply((0, 2, 3), 1.0),), "nothing is left for the common one"),
    ],
)
def test_impossible_supplies_are_refused(supplies: tuple[Supply, ...], said: str) -> None:
    with pytest.raises(FlowError, match=said):
        solve_flow(tubes(), FlowConditions(1e-3, inlet_flow_ul_s=1.0, supplies=supplies))


def test_inertia_follows_the_density() -> None:
    net = tubes()
    waves = [
        solve_pulsatile(
            net, PulsatileConditions(1e-3, Sine(4.0, 1.0, 1.0), supplies=OWN, density=density)
        ).pressure[1, 0]
        for density in (WATER_DENSITY, 2 * WATER_DENSITY)
    ]
    # A sine's phasor is imaginary, and so is what friction takes of it.
    assert waves[0].imag == pytest.approx(waves[1].imag)
    assert waves[1].real == pytest.approx(2 * waves[0].real)
