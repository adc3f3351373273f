"""Effective resistances from 3D flow, and the reduced model built from them."""

from __future__ import annotations

import numpy as np
import pytest

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.three_d import FlowOptions, solve_steady, straighten_edges
from design.hemodynamics.three_d.effective import effective_network, flow_error, rescaled
from design.hemodynamics.three_d.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.vessel_flows import conserve_mass, is_clear
from design.network import VesselNetwork
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


def test_flows_in_pieces_shorter_than_junctions_follow_from_the_others() -> None:
    """A ladder's rail between two rungs; what a section there says counts for nothing."""
    nodes = [[0.0, 0, 0], [6, 0, 0], [6.5, 0, 0], [6, 8, 0], [6.5, 8, 0]]
    network = network_of(nodes, [(0, 1), (1, 2), (1, 3), (2, 4)], 0.5)
    assert is_clear(network).tolist() == [True, False, True, True]
    ports = pipe(1, 1).ports
    outer = [
        type(ports[0])(node, np.array(nodes[node], float), np.ones(3), 0.5, node == 0)
        for node in (0, 3, 4)
    ]
    leaves = np.array([[-4.0, -8.0], [1.0, 2.0], [3.0, 6.0]])
    amid = np.array([[4.0, 8.0], [9.0, -9.0], [1.0, 2.0], [3.0, 6.0]])
    flow = conserve_mass(network, amid, outer, leaves)
    assert flow[1] == pytest.approx([3.0, 6.0], rel=1e-9)
    assert flow == pytest.approx(np.array([[4.0, 8], [3, 6], [1, 2], [3, 6]]), rel=1e-9)


def test_scaled_radii_scale_vessel_by_vessel() -> None:
    network = _fork()
    twice = rescaled(network, np.array([1.0, 2.0, 1.0]))
    ratio = solve_flow(twice, CONDITIONS).resistance / solve_flow(network, CONDITIONS).resistance
    assert ratio == pytest.approx([1.0, 1.0 / 16.0, 1.0])
