"""Steady 0D flow: closed forms, dense oracles, mass conservation, refusals."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from design.errors import FlowError
from design.hemodynamics import (
    FlowConditions,
    FlowSolution,
    OutletLoad,
    PowerLaw,
    PulsatileConditions,
    Supply,
    flow_structure,
    node_inflow,
    same_shear_conditions,
    solve_flow,
    solve_pulsatile,
    vessel_resistance,
)
from design.hemodynamics.waveforms import Sine
from design.hemodynamics.zero_d.nodal import structure_of
from design.network import VesselNetwork
from design.units import WATER_DENSITY
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree
from tests.design.networks import polyline
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
    network = network_of(nodes, ends, radius)
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
    ends = np.concatenate([tree.vessel_nodes, extra])
    network = network_of(tree.nodes, ends, np.exp(rng.normal(size=len(ends))))
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


@pytest.mark.parametrize(
    ("nodes", "ends", "radius"),
    [
        (
            [[0, 0, 0], [20, 0, 0], [20.01, 0, 0], [40, 1, 0], [40, -1, 0]],
            [(0, 1), (1, 2), (2, 3), (2, 4)],
            [0.01, 10.0, 0.01, 0.01],
        ),
        # The same in a loop, which no elimination of branches takes away.
        (
            [[0, 0, 0], [20, 0, 0], [20.5, 1, 0], [20.5, -1, 0], [40, 1, 0], [40, -1, 0]],
            [(0, 1), (1, 2), (1, 3), (2, 3), (2, 4), (3, 5)],
            [0.01, 2.0, 2.0, 2.0, 0.01, 0.02],
        ),
    ],
)
def test_mass_is_conserved_where_pressure_differences_drown_in_the_pressure(nodes, ends, radius):
    """A wide vessel's drop is 1e-16 of the pressure: p₀ - p₁ alone has no digit left."""
    network = network_of(nodes, ends, radius)
    driven = FlowConditions(VISCOSITY, inlet_pressure_pa=1e4, outlet_pressure_pa=9e3)
    solution = solve_flow(network, driven)
    assert _imbalance(network, solution, {0, *network.outlets().tolist()}) <= 1e-12


def test_inlets_on_one_supply_share_its_pressure_and_outlets_take_given_flows() -> None:
    nodes = [[0, 0, 0], [0, 2, 0], [1, 1, 0], [2, 1, 0]]
    network = network_of(nodes, [(0, 2), (1, 2), (2, 3)], [0.2, 0.4, 0.3])
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0))
    assert solution.pressure[0] == solution.pressure[1]
    assert solution.flow[:2].sum() == pytest.approx(1.0, rel=1e-13)
    assert solution.flow[1] / solution.flow[0] == pytest.approx(16.0, rel=1e-12)
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
    ends = node[network.vessel_nodes[vessel]]
    other = network_of(nodes, ends, network.mean_radius()[vessel])
    conditions = FlowConditions(VISCOSITY, inlet_pressure_pa=100.0)
    before, after = solve_flow(network, conditions), solve_flow(other, conditions)
    assert after.flow == pytest.approx(before.flow[vessel], rel=1e-10)
    assert after.pressure[node] == pytest.approx(before.pressure, rel=1e-10, abs=1e-12)


# Resistance against Poiseuille's law, and the taper's closed form against quadrature.


def test_straight_and_angled_vessels_have_poiseuilles_resistance() -> None:
    network = network_of([[0, 0, 0], [0, 3, 4]], [(0, 1)], 0.25)
    expected = 8 * VISCOSITY * 5.0 / (np.pi * 0.25**4)
    assert vessel_resistance(network, VISCOSITY) == pytest.approx([expected], rel=1e-14)
    angled = polyline([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]], 0.2)
    expected = 8 * VISCOSITY * 3.0 / (np.pi * 0.2**4)
    assert vessel_resistance(angled, VISCOSITY)[0] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(("first", "last"), [(0.5, 0.1), (0.1, 0.5), (0.3, 0.29999)])
def test_a_taper_has_the_integral_of_one_over_r4(first: float, last: float) -> None:
    network = polyline([[0.0, 0, 0], [7, 0, 0]], [first, last])
    integral = quad(lambda s: (first + (last - first) * s / 7) ** -4, 0, 7, epsrel=1e-12)[0]
    expected = 8 * VISCOSITY / np.pi * integral
    assert vessel_resistance(network, VISCOSITY)[0] == pytest.approx(expected, rel=1e-10)


def test_zero_length_no_outlet_and_a_pressure_left_open_are_refused() -> None:
    network = network_of([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [(0, 1), (1, 2)], 0.2)
    with pytest.raises(FlowError, match="vessel 1 has zero length"):
        vessel_resistance(network, VISCOSITY)
    nodes = [[0, 0, 0], [1, 0, 0], [0, 5, 0], [1, 5, 0], [0.5, 6, 0]]
    network = network_of(nodes, [(0, 1), (2, 3), (3, 4), (4, 3)], 0.2)
    with pytest.raises(FlowError, match=r"vessel 1 .*isolated part without outlet \(3 such"):
        solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0))
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0, outlet_flow_ul_s={2: 1.0})
    with pytest.raises(FlowError, match="no pressure is determined"):
        solve_flow(LINE, conditions)


# Inlets on supplies of their own: flows by hand, and what can't be.


def tubes() -> VesselNetwork:
    """Two unconnected parts: a tube, and two that join into one."""
    nodes = [[0, 0, 0], [9, 0, 0], [0, 5, 0], [0, 8, 0], [5, 6, 0], [9, 6, 0]]
    return network_of(nodes, [[0, 1], [2, 4], [3, 4], [4, 5]], 0.3)


OWN = (Supply((2, 3), 6.0),)


def test_each_supply_gives_its_own_flow() -> None:
    net = tubes()
    found = solve_flow(net, FlowConditions(1e-3, inlet_flow_ul_s=4.0, supplies=OWN))
    np.testing.assert_allclose(found.flow[[0, 3]], [4.0, 6.0])
    assert found.pressure[2] == pytest.approx(found.pressure[3])
    assert found.pressure[0] != pytest.approx(found.pressure[2])
    wider = same_shear_conditions(FlowConditions(1e-3, inlet_flow_ul_s=4.0, supplies=OWN), 2.0)
    assert wider.supplies[0].flow_ul_s == 48.0


def test_a_pulse_leaves_other_supplies_steady_and_its_inertia_follows_the_density() -> None:
    net = tubes()
    driven = PulsatileConditions(1e-3, Sine(4.0, 1.0, 1.0), supplies=OWN)
    flow = solve_pulsatile(net, driven).flow_in
    np.testing.assert_allclose(flow[0].real[[0, 3]], [4.0, 6.0])
    assert abs(flow[1, 0]) == pytest.approx(1.0)
    np.testing.assert_allclose(flow[1, 1:], 0.0, atol=1e-12)
    waves = [
        solve_pulsatile(
            net, PulsatileConditions(1e-3, Sine(4.0, 1.0, 1.0), supplies=OWN, density=density)
        ).pressure[1, 0]
        for density in (WATER_DENSITY, 2 * WATER_DENSITY)
    ]
    # A sine's phasor is imaginary, and so is what friction takes of it.
    assert waves[0].imag == pytest.approx(waves[1].imag)
    assert waves[1].real == pytest.approx(2 * waves[0].real)


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


# Problems without a unique solution, and conditions behind outlets.


LINE = network_of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1), (1, 2)], 0.2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "either inlet_flow_ul_s or inlet_pressure_pa"),
        ({"inlet_flow_ul_s": 1.0, "inlet_pressure_pa": 1.0}, "and not both"),
        ({"inlet_flow_ul_s": math.nan}, "inlet_flow_ul_s is nan"),
        ({"inlet_pressure_pa": 1.0, "outlet_pressure_pa": math.inf}, "outlet_pressure_pa is inf"),
        ({"inlet_pressure_pa": 1.0, "outlet_flow_ul_s": {2: math.nan}}, "node 2 is nan"),
        ({"viscosity_pa_s": 0.0, "inlet_flow_ul_s": 1.0}, "viscosity"),
        ({"viscosity_pa_s": -1.0, "inlet_flow_ul_s": 1.0}, "viscosity"),
        ({"viscosity_pa_s": math.nan, "inlet_flow_ul_s": 1.0}, "viscosity"),
        ({"inlet_flow_ul_s": 1.0, "outlets": ()}, "no outlet"),
        ({"inlet_flow_ul_s": 1.0, "inlets": (7,)}, "inlet 7 isn't a node"),
        ({"inlet_flow_ul_s": 1.0, "inlets": (0, 2)}, "node 2 is both"),
        ({"inlet_flow_ul_s": 1.0, "outlet_flow_ul_s": {1: 0.5}}, "node 1 isn't one of the out"),
    ],
)
def test_conditions_must_be_whole_and_ends_nodes(given: dict[str, Any], message: str) -> None:
    with pytest.raises(FlowError, match=message):
        solve_flow(LINE, FlowConditions(**{"viscosity_pa_s": VISCOSITY, **given}))


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


# Elimination on graphs, against dense linear algebra, real and complex.


def _graph(seed: int, count: int, links: int) -> np.ndarray:
    """A random tree and links more, some of them twice, some from a node to itself."""
    rng = np.random.default_rng(seed)
    tree = [(int(rng.integers(0, k)), k) for k in range(1, count)]
    more = rng.integers(0, count, (links, 2))
    return np.concatenate([np.array(tree), more, more[: links // 3]])


def _dense(
    ends: np.ndarray, admittance: np.ndarray, ground: np.ndarray, fixed: np.ndarray,
    injected: np.ndarray, given: np.ndarray,
) -> np.ndarray:  # fmt: skip
    matrix = np.diag(ground.astype(admittance.dtype))
    for (a, b), y in zip(ends, admittance, strict=True):
        matrix[a, a] += y
        matrix[b, b] += y
        matrix[a, b] -= y
        matrix[b, a] -= y
    matrix[fixed] = np.eye(len(fixed))[fixed]
    return np.linalg.solve(matrix, np.where(fixed, given, injected))


@pytest.mark.parametrize(("count", "links"), [(30, 0), (30, 12), (60, 90), (120, 3000)])
@pytest.mark.parametrize("turned", [False, True])
def test_a_graph_is_solved_as_dense_algebra_does(count: int, links: int, turned: bool) -> None:
    rng = np.random.default_rng(count + links)
    ends = _graph(count, count, links)
    admittance = np.exp(rng.normal(size=len(ends)))
    ground = np.where(rng.random(count) < 0.1, 0.3, 0.0)
    if turned:
        admittance = admittance * np.exp(1j * rng.uniform(-1, 1, len(ends)))
        ground = ground * 1j
    fixed = np.arange(count) % 17 == 3
    injected, given = rng.normal(size=count), rng.normal(size=count)
    structure = structure_of(ends, fixed)
    assert (len(structure.plan.left) > 0) == (links > 0)
    system = structure.factorise(admittance, ground.astype(admittance.dtype))
    pressure, flow = system.balanced(np.where(fixed, 0.0, injected), given)
    wanted = _dense(ends, admittance, ground, fixed, injected, given)
    assert pressure == pytest.approx(wanted, rel=1e-10, abs=1e-10)
    drop = wanted[ends[:, 0]] - wanted[ends[:, 1]]
    assert flow == pytest.approx(admittance * drop, rel=1e-9, abs=1e-9)


def test_ladders_whose_conductances_lie_far_apart_lose_no_digit() -> None:
    """Two rails and rungs, from 1e-12 to 1e12: by symmetry rungs carry nothing."""
    count, rng = 60, np.random.default_rng(1)
    rail = np.column_stack([np.arange(count - 1), np.arange(1, count)])
    ends = np.concatenate([rail, rail + count, np.column_stack([np.arange(count)] * 2)])
    ends[2 * (count - 1) :, 1] += count
    along = 10.0 ** rng.uniform(-12, 12, count - 1)
    admittance = np.concatenate([along, along, 10.0 ** rng.uniform(-12, 12, count)])
    fixed = np.zeros(2 * count, dtype=bool)
    fixed[[count - 1, 2 * count - 1]] = True
    injected = np.zeros(2 * count)
    injected[[0, count]] = 1.0
    _, flow = structure_of(ends, fixed).factorise(admittance).balanced(injected, 0.0 * injected)
    assert flow[: 2 * (count - 1)] == pytest.approx(np.ones(2 * (count - 1)), rel=1e-12)


def test_a_structure_serves_other_radii_and_pressures_and_no_other_network() -> None:
    network, other = random_tree(1, 30), random_tree(1, 30, 0.2)
    conditions = FlowConditions(VISCOSITY, inlet_pressure_pa=10.0)
    known = flow_structure(network, conditions)
    again = FlowConditions(2 * VISCOSITY, inlet_pressure_pa=99.0, outlet_pressure_pa=3.0)
    by_known, alone = solve_flow(other, again, known), solve_flow(other, again)
    assert by_known.flow.tolist() == alone.flow.tolist()
    assert by_known.pressure.tolist() == alone.pressure.tolist()
    for wrong_network, wrong in (
        (random_tree(2, 30), conditions),
        (network, FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0)),
    ):
        with pytest.raises(FlowError, match="another network, or of other inlets"):
            solve_flow(wrong_network, wrong, known)


def test_a_supply_joins_parts_of_which_one_has_flows_only() -> None:
    """Two lines, the second with a flow out of it: the supply's pressure is the first's."""
    network = network_of([[0, 0, 0], [1, 0, 0], [0, 5, 0], [1, 5, 0]], [(0, 1), (2, 3)], 0.2)
    conditions = FlowConditions(
        VISCOSITY, inlet_flow_ul_s=2.0, outlet_flow_ul_s={3: 1.0}, inlets=(0, 2)
    )
    found = solve_flow(network, conditions)
    assert found.flow.tolist() == pytest.approx([1.0, 1.0])
    assert found.pressure[2] == found.pressure[0]
