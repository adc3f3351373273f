"""Graph elimination in the flow solver, against dense linear algebra, real and complex."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import FlowConditions, flow_structure, solve_flow
from design.hemodynamics.zero_d.nodal.conductance import structure_of
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree


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
