"""Strahler orders, bifurcations, paths and terminals, against their definitions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.hemodynamics import FlowConditions, solve_flow
from design.measures.junctions import measure_murray, measure_terminal_flow
from design.measures.morphometry import (
    diameter_defined_orders,
    measure_morphometry,
)
from design.measures.path_lengths import measure_paths
from design.network import VesselKind, VesselNetwork
from design.tissue import block
from design.vasculature import GrowthOptions, grow_tree, planar_four_vessel, tree_to_network
from tests.design.measures.oracles import random_tree, strahler, tree_network
from tests.design.tissue.kept import kept_tissue
from tests.slower import examples


@settings(deadline=None, max_examples=examples(40))
@given(seed=st.integers(0, 2**32), vessels=st.integers(1, 40), kind=st.sampled_from([0, 1]))
def test_strahler_orders_are_those_of_the_definition(seed: int, vessels: int, kind: int) -> None:
    random = np.random.default_rng(seed)
    parents, nodes = random_tree(random, vessels)
    network = tree_network(parents, nodes, random.uniform(0.1, 1.0, vessels), kind)
    (found,) = measure_morphometry(network)
    assert found.kind == VesselKind(kind)
    assert found.strahler_order.tolist() == [strahler(parents, i) for i in range(vessels)]
    assert found.strahler.segments.sum() == vessels
    length = network.lengths().sum()
    for table in (found.strahler, found.diameter_defined):
        assert (table.element_length_mean_mm * table.elements).sum() == pytest.approx(length)
        assert (table.segment_length_mean_mm * table.segments).sum() == pytest.approx(length)
        springing = (table.connectivity * table.elements).sum()
        assert springing == pytest.approx(table.elements.sum() - 1)


def test_a_symmetric_tree_has_textbook_orders() -> None:
    levels = 6
    parents = [-1] + [(i - 1) // 2 for i in range(1, 2**levels - 1 + 1) if i < 2**levels - 1]
    nodes = np.random.default_rng(0).uniform(0, 10, (len(parents) + 1, 3))
    level = np.floor(np.log2(np.arange(len(parents)) + 1)).astype(int)
    network = tree_network(parents, nodes, 2.0 ** (-level / 3.0))
    (found,) = measure_morphometry(network)
    np.testing.assert_array_equal(found.strahler_order, levels - level)
    np.testing.assert_array_equal(found.diameter_order, levels - level)
    assert found.diameter_order_change == 0.0
    for table in (found.strahler, found.diameter_defined):
        assert table.elements.tolist() == [32, 16, 8, 4, 2, 1]
        assert table.branching_ratio == pytest.approx(2.0)
        assert table.diameter_ratio == pytest.approx(2.0 ** (1.0 / 3.0))
        np.testing.assert_allclose(table.connectivity, np.diag([2.0] * 5, 1))
        np.testing.assert_allclose(table.diameter_sd_mm, 0.0, atol=1e-12)


def test_diameter_orders_part_clear_groups_that_strahler_mixes() -> None:
    diameter = np.repeat([0.1, 0.2, 0.4], 10) * np.tile(np.linspace(0.97, 1.03, 10), 3)
    mixed = np.repeat([1, 2, 3], 10)
    mixed[9], mixed[10], mixed[19], mixed[20] = 2, 1, 3, 2
    found, change = diameter_defined_orders(diameter, mixed)
    np.testing.assert_array_equal(found, np.repeat([1, 2, 3], 10))
    assert change < 0.01


def test_a_half_circle_is_half_pi_as_long_as_its_chord() -> None:
    angle = np.linspace(0.0, np.pi, 200)
    points = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    network = VesselNetwork(
        points[[0, -1]],
        np.array([[0, 1]]),
        np.zeros(1, dtype=int),
        np.zeros(1, dtype=int),
        np.array([0, 200]),
        points,
        np.full(200, 0.1),
    )
    ways = measure_paths(network)
    assert ways is not None
    assert ways.tortuosity_max == pytest.approx(np.pi / 2, rel=1e-4)
    assert ways.vessel_tortuosity_mean == ways.tortuosity_mean


def test_a_grown_tree_obeys_murray_and_feeds_its_terminals_equally() -> None:
    surface = block((10.0, 10.0, 10.0))
    cube = kept_tissue(surface)
    network = tree_to_network(grow_tree(cube, GrowthOptions(terminals=60, seed=2)))
    murray = measure_murray(network, 3.0)
    assert murray is not None
    assert murray.forks == 59
    assert max(-murray.least, murray.greatest, murray.p95) < 1e-12
    flow = solve_flow(network, FlowConditions(4e-3, inlet_flow_ul_s=1.0)).flow
    terminal = measure_terminal_flow(network, flow)
    assert terminal is not None
    assert terminal.terminals == 60
    assert terminal.mean_ul_s == pytest.approx(1.0 / 60.0)
    assert terminal.cv <= terminal.spread < 1e-9
    other = measure_murray(network, 2.0)
    assert other is not None
    assert other.mean > 0.1


def test_terminals_of_a_closed_loop_are_its_connections() -> None:
    network = planar_four_vessel()
    assert measure_terminal_flow(network, np.ones(14)) is None
    kind = network.kind.copy()
    kind[5:9] = VesselKind.CONNECTION
    flow = np.ones(14)
    flow[5:9] = [1.0, -2.0, 3.0, 2.0]
    found = measure_terminal_flow(replace(network, kind=kind), flow)
    assert found is not None
    assert (found.terminals, found.mean_ul_s, found.spread) == (4, 2.0, 1.0)


def test_murray_residual_of_a_fork_and_of_its_mirror() -> None:
    radius = np.array([1.0, 0.5, 0.7])
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0]])
    for kind in (0, 1):
        found = measure_murray(tree_network([-1, 0, 0], nodes, radius, kind), 3.0)
        assert found is not None
        assert found.mean == pytest.approx(0.5**3 + 0.7**3 - 1.0)
