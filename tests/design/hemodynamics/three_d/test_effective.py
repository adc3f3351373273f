"""Effective resistances from 3D flow, and the reduced model built from them."""

from __future__ import annotations

import numpy as np
import pytest

from design.hemodynamics import FlowConditions
from design.hemodynamics.three_d import FlowOptions, solve_steady, straighten_edges
from design.hemodynamics.three_d.effective import effective_network, flow_error
from design.hemodynamics.three_d.mesh import MeshOptions, lumen_mesh
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
