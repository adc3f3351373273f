"""Effective resistances from 3D flow, and the reduced model built from them."""

from __future__ import annotations

import numpy as np
import pytest

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.three_d import FlowOptions, solve_steady, straighten_edges
from design.hemodynamics.three_d.effective import effective_network, flow_error, rescaled
from design.hemodynamics.three_d.lumen_mesh import MeshPort
from design.hemodynamics.three_d.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.sections import conserve_mass, is_clear
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.lumens import pipe

pytest.importorskip("ngsolve")

CONDITIONS = FlowConditions(1e-3, inlet_flow_ul_s=4.0)


def _fork() -> VesselNetwork:
    nodes = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [5.0, 1.6, 0.0], [5.2, -1.2, 0.0]]
    return network_of(nodes, [(0, 1), (1, 2), (1, 3)], [0.5, 0.4, 0.35])


def test_a_pipe_resists_as_poiseuille_says_and_loses_nothing_at_its_ends() -> None:
    network = network_of([[0, 0, 0], [0, 0, 4.0]], [(0, 1)], 0.5)
    solution = solve_steady(pipe(2, 8), CONDITIONS)
    found = effective_network(network, CONDITIONS, solution)
    assert found.resistance == pytest.approx(found.nominal, rel=1e-3)
    assert found.clear == pytest.approx([1.0], abs=2e-3)
    assert found.flow == pytest.approx([4.0], rel=1e-6)
    assert np.abs(found.loss).max() < 2e-3 * np.ptp(found.pressure)
    assert found.network.radius == pytest.approx(network.radius, rel=1e-3)


@pytest.mark.slow
def test_a_pipe_wider_than_drawn_has_the_wider_radius() -> None:
    """The lumen is that of 0.5 mm; the network says 0.45."""
    network = network_of([[0, 0, 0], [0, 0, 4.0]], [(0, 1)], 0.45)
    found = effective_network(network, CONDITIONS, solve_steady(pipe(2, 8), CONDITIONS))
    assert found.network.radius == pytest.approx(np.full(2, 0.5), rel=1e-3)
    assert found.clear == pytest.approx([(0.45 / 0.5) ** 4], rel=3e-3)


def test_the_reduced_network_has_the_flows_and_pressures_of_3d() -> None:
    network = _fork()
    mesh, _ = straighten_edges(lumen_mesh(network, MeshOptions(edge_ratio=0.8)))
    solution = solve_steady(mesh, CONDITIONS, FlowOptions(order=2))
    found = effective_network(network, CONDITIONS, solution)
    assert found.told.all()
    before, after = (flow_error(each, CONDITIONS, found) for each in (network, found.network))
    assert after.flow < 1e-3 < before.pressure
    assert after.pressure < 2e-3
    fall = found.pressure[network.vessel_nodes] @ [1.0, -1.0]
    assert fall == pytest.approx(found.resistance * found.flow, rel=1e-9)
    assert found.clear == pytest.approx(np.ones(3), abs=0.03)


LADDER = [[0.0, 0, 0], [6, 0, 0], [6.5, 0, 0], [6, 8, 0], [6.5, 8, 0]]


def _leaving(
    network: VesselNetwork, flows: dict[int, list[float]]
) -> tuple[list[MeshPort], FloatArray]:
    ports = [MeshPort(n, network.nodes[n], np.ones(3), 0.5, f[0] < 0.0) for n, f in flows.items()]
    return ports, np.array(list(flows.values()))


def test_flows_without_a_clear_section_follow_from_the_others() -> None:
    """A ladder's rail between two rungs; a loop of such pieces has no figure."""
    network = network_of(LADDER, [(0, 1), (1, 2), (1, 3), (2, 4)], 0.5)
    assert is_clear(network).tolist() == [True, False, True, True]
    ports, leaves = _leaving(network, {0: [-4.0, -8.0], 3: [1.0, 2.0], 4: [3.0, 6.0]})
    amid = np.array([[4.0, 8.0], [np.nan, np.nan], [1.0, 2.0], [3.0, 6.0]])
    flow = conserve_mass(network, amid, ports, leaves)
    assert flow == pytest.approx(np.array([[4.0, 8], [3, 6], [1, 2], [3, 6]]), rel=1e-9)
    twice = network_of(LADDER, [(0, 1), (1, 2), (1, 2), (1, 3), (2, 4)], 0.5)
    flow = conserve_mass(twice, np.insert(amid, 1, np.nan, axis=0), ports, leaves)
    assert np.isnan(flow[1:3]).all()
    assert flow[[0, 3, 4]] == pytest.approx(np.array([[4.0, 8], [1, 2], [3, 6]]), rel=1e-9)


def test_a_wrong_section_is_left_out_and_not_spread_round_the_loops() -> None:
    """A ladder of 12 rungs, a hundredth of the flow in each of the far ones; one is read at 1.3."""
    count = 12
    nodes = [[float(k), y, 0.0] for y in (0.0, 5.0) for k in range(count)]
    rails = [(k, k + 1) for k in range(count - 1)]
    ends = (
        rails + [(a + count, b + count) for a, b in rails] + [(k, k + count) for k in range(count)]
    )
    network = network_of(nodes, ends, 0.1)
    rung = np.concatenate([[60.0, 30.0], np.ones(count - 2)])
    carried = rung.sum() - np.cumsum(rung)[:-1]
    exact = np.concatenate([carried, rung.sum() - carried, rung])[:, None]
    ports, leaves = _leaving(network, {0: [-100.0], 2 * count - 1: [100.0]})
    noise = 1.0 + 0.005 * np.random.default_rng(1).normal(size=exact.shape)
    read = exact * noise
    read[-4] *= 1.3
    off = np.abs(conserve_mass(network, read, ports, leaves) / exact - 1.0)
    assert off.max() < 0.02
    # As errors of 0.5 % of the rails' flow are: half the rungs' flow.
    assert np.abs(conserve_mass(network, exact * noise, ports, leaves) / exact - 1.0).max() < 0.015


def test_scaled_radii_scale_vessel_by_vessel() -> None:
    network = _fork()
    twice = rescaled(network, np.array([1.0, 2.0, 1.0]))
    ratio = solve_flow(twice, CONDITIONS).resistance / solve_flow(network, CONDITIONS).resistance
    assert ratio == pytest.approx([1.0, 1.0 / 16.0, 1.0])
