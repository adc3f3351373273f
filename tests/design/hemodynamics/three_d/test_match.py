"""Vessel radii adjusted to wanted 3D flows; effective resistances of 3D flow."""

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import FlowConditions, Probes, solve_flow
from design.hemodynamics.three_d import FlowOptions, probe_steady, solve_steady, straighten_edges
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.vessels.effective import effective_network, flow_error
from design.hemodynamics.three_d.vessels.match import (
    MatchOptions,
    free_radii,
    ideal_target,
    match_split,
    next_scales,
    outlet_target,
)
from design.network import VesselNetwork
from design.vasculature import planar_four_vessel
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.three_d.lumens import pipe

pytest.importorskip("ngsolve")

FAST = FlowConditions(1e-3, inlet_flow_ul_s=33.0)
COARSE = MatchOptions(tolerance=0.02, mesh=MeshOptions(edge_ratio=0.9))


def _fork() -> VesselNetwork:
    """Short, and so fast that inertia sends too much straight on."""
    nodes = [[0.0, 0.0, 0.0], [2.5, 0.0, 0.0], [4.5, 0.3, 0.0], [3.0, -2.0, 0.0]]
    return network_of(nodes, [(0, 1), (1, 2), (1, 3)], [0.5, 0.4, 0.4])


@pytest.mark.slow
def test_a_fork_gets_the_split_it_was_designed_for() -> None:
    network = _fork()
    done = match_split(network, FAST, options=COARSE)
    assert done.met
    assert done.history[0].worst > COARSE.tolerance >= done.history[done.best].worst
    assert len(done.history) <= 4
    assert done.bounded == ()
    # The root's radius doesn't decide the split, and stays.
    assert done.network.radius[:2] == pytest.approx(network.radius[:2])
    # What the history says is what the network of the best round carries.
    wanted = solve_flow(network, FAST).flow
    assert np.abs(done.effective.flow - wanted).max() == pytest.approx(
        33.0 * done.history[done.best].worst, rel=1e-6
    )


@pytest.mark.slow
def test_flows_can_be_asked_for_at_outlets() -> None:
    network = _fork()
    target = outlet_target(network, FAST, {2: 11.0, 3: 22.0})
    done = match_split(network, FAST, target, COARSE)
    assert done.met
    assert done.effective.flow[1] == pytest.approx(11.0, abs=0.02 * 33.0)
    assert done.network.radius[4] > network.radius[4] > 0.0
    assert done.network.radius[2] < network.radius[2]


@pytest.mark.slow
def test_bounds_are_kept_and_told() -> None:
    network = _fork()
    options = replace(COARSE, least_radius_mm=0.39, most_change=1.02, rounds=2)
    done = match_split(network, FAST, outlet_target(network, FAST, {2: 5.0}), options)
    assert not done.met
    assert set(done.bounded) == {1, 2}
    assert done.network.radius.min() >= 0.39 * (1 - 1e-9)
    assert done.network.radius.max() <= max(0.5, 0.4 * 1.02) * (1 + 1e-9)
    with pytest.raises(FlowError, match=r"below the least that is to be printed, 0\.45"):
        match_split(network, FAST, options=replace(COARSE, least_radius_mm=0.45))


@pytest.mark.slow
def test_the_reduced_model_is_brought_to_the_target_at_once() -> None:
    """With the resistances of 3D held, the next radii have the wanted flows to rounding."""
    network = _fork()
    mesh, _ = straighten_edges(lumen_mesh(network, COARSE.mesh))
    found = effective_network(network, FAST, solve_steady(mesh, FAST, FlowOptions(order=2)))
    target = ideal_target(network, FAST)
    scale = next_scales(network, FAST, target, found, free_radii(network, COARSE), np.ones(3))
    owner = np.repeat(np.arange(3), 2)
    guess = replace(found.network, radius=found.network.radius * scale[owner])
    assert solve_flow(guess, FAST).flow == pytest.approx(target.flow, rel=1e-5)


def test_what_cannot_be_wanted_is_refused() -> None:
    network = _fork()
    for flows, said in (
        ({1: 3.0}, "node 1 is given a flow and isn't an outlet"),
        ({2: -1.0}, "wanted out of node 2 is -1"),
        ({2: 10.0, 3: 10.0}, "sum to 20 .* the inlet has 33"),
        ({2: 40.0}, "sum to 40"),
    ):
        with pytest.raises(FlowError, match=said):
            outlet_target(network, FAST, flows)
    with pytest.raises(FlowError, match="tolerance 1e-06"):
        MatchOptions(tolerance=1e-6)


@pytest.mark.slow
def test_the_planar_network_comes_within_a_thousandth() -> None:
    network = planar_four_vessel()
    conditions = FlowConditions(1e-3, inlet_flow_ul_s=0.25 * 1000.0 / 60.0)
    done = match_split(network, conditions, options=MatchOptions(tolerance=0.001))
    assert done.met
    assert done.history[0].worst > 0.003
    assert len(done.history) <= 4
    # Again, of the other order, by the sections of the channels.
    mesh, _ = straighten_edges(lumen_mesh(done.network))
    again = solve_steady(mesh, conditions, FlowOptions(order=3))
    probes = Probes(np.array([5, 6, 7, 8]), np.full(4, 0.5))
    flow = probe_steady(done.network, probes, again.field).flow[:, 0]
    assert flow == pytest.approx(done.target.flow[5:9], abs=0.0015 * 4.1667)


# Effective resistances, and the reduced model built from them.


pytest.importorskip("ngsolve")

CONDITIONS = FlowConditions(1e-3, inlet_flow_ul_s=4.0)


def _slow_fork() -> VesselNetwork:
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
    network = _slow_fork()
    mesh, _ = straighten_edges(lumen_mesh(network, MeshOptions(edge_ratio=0.8)))
    solution = solve_steady(mesh, CONDITIONS, FlowOptions(order=2))
    found = effective_network(network, CONDITIONS, solution)
    assert found.known.all()
    before, after = (flow_error(each, CONDITIONS, found) for each in (network, found.network))
    assert after.flow < 1e-3 < before.pressure
    assert after.pressure < 2e-3
    fall = found.pressure[network.vessel_nodes] @ [1.0, -1.0]
    assert fall == pytest.approx(found.resistance * found.flow, rel=1e-9)
    assert found.clear == pytest.approx(np.ones(3), abs=0.03)
