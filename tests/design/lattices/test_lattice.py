"""Lattices: unit cells, clipping, ports."""

from typing import get_args

import networkx
import numpy as np
import pytest

from design.errors import NetworkError, TissueError
from design.hemodynamics import FlowConditions, solve_flow
from design.lattices import LatticeKind, LatticeOptions, build_lattice
from design.lattices.lattice import tile, unit_cell
from design.measures import MeasureOptions, measure_network
from design.tissue import Tissue, annulus, block, cylinder
from design.vasculature import collisions
from tests.design.tissue.kept import kept_tissue
from tests.slower import first_of

KINDS = get_args(LatticeKind)


@pytest.fixture(scope="module")
def rod() -> Tissue:
    return kept_tissue(cylinder(24.0, 16.0))


@pytest.mark.parametrize(
    ("kind", "nodes", "degree", "ring"),
    [("grid", 1, 6, 4), ("honeycomb", 4, 5, 4), ("gyroid", 8, 3, 10), ("diamond", 8, 4, 6)],
)
def test_each_node_has_the_bonds_and_shortest_rings_of_its_net(kind, nodes, degree, ring) -> None:
    cell = unit_cell(kind)
    assert len(cell.nodes) == nodes
    np.testing.assert_array_equal(np.bincount(cell.bonds.ravel()), degree)

    _, bonds = tile(cell, (3, 3, 3))
    assert networkx.girth(networkx.Graph(bonds.tolist())) == ring


@pytest.mark.parametrize("axis", first_of("xyz"))
@pytest.mark.parametrize("kind", KINDS)
def test_a_lattice_has_one_inlet_one_outlet_and_no_dead_end(rod, kind, axis):
    options = LatticeOptions(kind, 4.5, 0.3, axis=axis, clearance_mm=0.2)  # type: ignore[arg-type]
    network = build_lattice(rod, options)
    assert network.inlets().tolist() == [len(network.nodes) - 2]
    assert network.outlets().tolist() == [len(network.nodes) - 1]
    degree = network.degree()
    assert (degree[:-2] >= 2).all()
    assert (degree[-2:] == 1).all()
    found = collisions(network, 0.2)
    assert found.count == 0
    start, end, radius, _, _ = network.pieces()
    assert rod.grid.capsule_inside(start[:-2], end[:-2], radius[:-2], 0.2).all()
    np.testing.assert_allclose(rod.grid.distance(network.nodes[-2:]), 0.0, atol=0.05)
    way = network.nodes[-1] - network.nodes[-2]
    assert way["xyz".index(axis)] > 0.0
    assert set(np.unique(network.radius)) == {0.3, 0.3 * 1.5}


@pytest.mark.parametrize("kind", KINDS)
def test_flow_goes_through_every_lattice_and_its_measures_are_taken(rod, kind):
    network = build_lattice(rod, LatticeOptions(kind, 5.0, 0.25))
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=4.0)).flow
    assert flow[-1] == pytest.approx(4.0)
    assert flow.min() > -1e-9
    measured = measure_network(network, rod, MeasureOptions(samples=5000), flow)
    assert measured.morphometry == ()
    assert measured.supply is not None
    assert measured.supply.distance_mean_mm < 4.0
    assert measured.ways is not None
    assert measured.ways.depth_max >= 4


def test_ports_lead_around_a_hole() -> None:
    ring = kept_tissue(annulus(30.0, 14.0, 12.0))
    network = build_lattice(ring, LatticeOptions("grid", 3.0, 0.3, axis="x"))
    assert len(network.inlets()) == len(network.outlets()) == 1
    assert ring.contains(network.nodes[:-2]).all()
    assert np.hypot(*network.nodes[-2:, :2].T) == pytest.approx([15.0, 15.0], rel=0.02)


def test_channels_that_would_meet_and_lattices_too_coarse_are_refused(rod: Tissue) -> None:
    with pytest.raises(NetworkError, match="enlarge the cell"):
        build_lattice(rod, LatticeOptions("gyroid", 2.0, 0.3))
    cube = kept_tissue(block((5.0, 5.0, 5.0)))
    with pytest.raises(TissueError, match="fits into the tissue"):
        build_lattice(cube, LatticeOptions("diamond", 9.0, 0.3))


@pytest.mark.parametrize(
    "options",
    [("cubic", 1.0, 0.1), ("grid", -1.0, 0.1), ("grid", 1.0, 0.0), ("grid", 1.0, 0.2, 0.1)],
)
def test_impossible_options_are_refused(options: tuple[str, float, float]) -> None:
    with pytest.raises(NetworkError, match="lattice"):
        LatticeOptions(*options)  # type: ignore[arg-type]
