"""Measures of networks (orders, forks, paths, distances, oxygen), against closed forms."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import DesignError
from design.hemodynamics import FlowConditions, solve_flow
from design.measures import MeasureOptions, OxygenModel, Supply, measure_network, measures_dict
from design.measures.junctions import measure_murray, measure_terminal_flow
from design.measures.measure import measure_territories
from design.measures.morphometry import (
    diameter_defined_orders,
    measure_morphometry,
)
from design.measures.paths import measure_paths
from design.measures.supply import build_lumens, krogh_erlang, nearest_walls, sample_tissue
from design.network import VesselKind, VesselNetwork
from design.tissue import Tissue, block, cylinder
from design.vasculature import GrowthOptions, grow_tree, planar_four_vessel, tree_to_network
from tests.design.measures.oracles import random_tree, strahler, tree_network, wall_distances
from tests.design.networks import network, polyline
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
    ways = measure_paths(polyline(points, 0.1))
    assert ways is not None
    assert ways.tortuosity_max == pytest.approx(np.pi / 2, rel=1e-4)
    assert ways.vessel_tortuosity_mean == ways.tortuosity_mean


def test_a_grown_tree_obeys_murray_and_feeds_its_terminals_equally() -> None:
    cube = kept_tissue(block((10.0, 10.0, 10.0)))
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


# Supply: distances, vessels per section, oxygen.


RADIUS, LENGTH, LUMEN = 4.0, 20.0, 0.5


@pytest.fixture(scope="module")
def rod() -> Tissue:
    return kept_tissue(cylinder(2.0 * RADIUS, LENGTH, sides=720))


def straight(radius: float = LUMEN, over: float = 1.0) -> VesselNetwork:
    """A vessel along the rod's axis, reaching ``over`` beyond both its ends."""
    return polyline(np.array([[0.0, 0.0, -over], [0.0, 0.0, LENGTH + over]]), radius)


def supply(net: VesselNetwork, tissue: Tissue, **options: object) -> Supply:
    measured = measure_network(net, tissue, MeasureOptions(**options)).supply  # type: ignore[arg-type]
    assert measured is not None
    return measured


@pytest.mark.slow
def test_a_straight_vessel_in_a_rod_has_the_distances_of_its_annulus(rod: Tissue) -> None:
    found = supply(straight(), rod, samples=100_000)
    area = RADIUS**2 - LUMEN**2
    mean = 2.0 / 3.0 * (RADIUS**3 - LUMEN**3) / area - LUMEN
    p95 = np.sqrt(LUMEN**2 + 0.95 * area) - LUMEN
    assert found.distance_mean_mm == pytest.approx(mean, rel=5e-3)
    assert found.distance_p95_mm == pytest.approx(p95, rel=5e-3)
    assert found.distance_max_mm == pytest.approx(RADIUS - LUMEN, rel=5e-3)
    for limit, share in zip((0.02, 0.1, 0.15, 0.2), found.beyond, strict=True):
        exact = (RADIUS**2 - (LUMEN + limit) ** 2) / area
        assert share == pytest.approx(exact, abs=4.0 * np.sqrt(exact * (1 - exact) / 1e5) + 1e-4)
    assert found.lumen_fraction == pytest.approx(LUMEN**2 / RADIUS**2, abs=2e-3)


def test_sections_agree_with_planes_cut_at_random() -> None:
    cube = kept_tissue(block((10.0, 10.0, 10.0)))
    random = np.random.default_rng(3)
    tree = tree_network(*random_tree(random, 40), np.full(40, 0.05))
    found = supply(tree, cube, samples=100)
    start, end, *_ = tree.pieces()
    planes = np.linspace(0.0, 10.0, 4001)
    for axis in range(3):
        low = np.minimum(start[:, axis], end[:, axis])
        high = np.maximum(start[:, axis], end[:, axis])
        crossings = [int(((low < h) & (h < high)).sum()) for h in planes]
        assert found.sections_per_mm2[axis] == pytest.approx(np.mean(crossings) / 100, rel=1e-2)


@settings(deadline=None, max_examples=examples(25))
@given(seed=st.integers(0, 2**32), vessels=st.integers(1, 30))
def test_nearest_wall_is_that_of_the_nearest_of_all_spheres(seed: int, vessels: int) -> None:
    random = np.random.default_rng(seed)
    parents, nodes = random_tree(random, vessels)
    network = tree_network(parents, nodes, np.ones(vessels))
    network = replace(network, radius=random.uniform(0.01, 1.5, len(network.radius)))
    points = random.uniform(-3.0, 13.0, (50, 3))
    start, end, ra, rb, _ = network.pieces()
    distance, radius = nearest_walls(build_lumens(start, end, ra, rb), points)
    slow = wall_distances(network, points)
    assert np.all(distance <= slow + 1e-9)
    np.testing.assert_allclose(distance, slow, atol=1e-6)
    assert radius.min() >= network.radius.min() - 1e-12
    assert radius.max() <= network.radius.max() + 1e-12


def test_samples_are_uniform_and_repeatable(rod: Tissue) -> None:
    points = sample_tissue(rod, 20_000, 7)
    np.testing.assert_array_equal(points, sample_tissue(rod, 20_000, 7))
    assert rod.contains(points).all()
    np.testing.assert_allclose(points.mean(axis=0), [0, 0, LENGTH / 2], atol=0.15)
    assert np.hypot(*points[:, :2].T).mean() == pytest.approx(2.0 / 3.0 * RADIUS, rel=1e-2)


def test_printable_lumens_alone_are_those_at_least_as_wide(rod: Tissue) -> None:
    nodes = np.array([[0.0, 0, 1], [0, 0, 10], [2.0, 0, 15], [-2.0, 0, 15]])
    radius = np.array([0.5, 0.25, 0.2])
    forked = network(nodes, [[0, 1], [1, 2], [1, 3]], radius)
    wide = network(nodes[:3], [[0, 1], [1, 2]], radius[:2])
    options = MeasureOptions(samples=2000, printable_diameter_mm=0.5)
    assert measure_network(forked, rod, options).printable == supply(wide, rod, samples=2000)
    none = measure_network(forked, rod, replace(options, printable_diameter_mm=1.1))
    assert none.printable is None


def test_oxygen_in_a_rod_is_kroghs(rod: Tissue) -> None:
    model = OxygenModel(cells_per_ml=1e5)
    found = supply(straight(over=0.0), rod, samples=100_000, oxygen=model).oxygen
    r = np.sqrt(np.linspace(LUMEN**2, RADIUS**2, 200_001))
    exact = krogh_erlang(r, np.full_like(r, LUMEN), np.full_like(r, RADIUS), model)
    assert exact.min() > 0.0
    assert found.anoxic == 0.0
    assert found.mean_millimolar == pytest.approx(exact.mean(), rel=2e-3)
    assert found.p5_millimolar == pytest.approx(np.percentile(exact, 5), rel=2e-3)
    assert found.least_millimolar == pytest.approx(exact[-1], rel=2e-3)


def test_krogh_erlang_solves_its_equation() -> None:
    model = OxygenModel()
    r = np.linspace(0.05, 0.3, 4001)
    c = krogh_erlang(r, np.full_like(r, 0.05), np.full_like(r, 0.3), model)
    flux = r * np.gradient(c, r)
    left = model.diffusivity_mm2_s * np.gradient(flux, r) / r
    assert c[0] == model.lumen_millimolar
    assert flux[-1] == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_allclose(left[5:-5], model.uptake_millimolar_s, rtol=1e-3)


@pytest.mark.parametrize(
    "options", [{"samples": 0}, {"murray_exponent": 0.0}, {"printable_diameter_mm": -1.0}]
)
def test_impossible_options_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(DesignError, match="measures"):
        MeasureOptions(**options)  # type: ignore[arg-type]


def test_the_dictionary_is_plain_json(rod: Tissue) -> None:
    options = MeasureOptions(samples=500, printable_diameter_mm=0.3)
    measured = measure_network(straight(), rod, options, flow=np.array([1.0]))
    table = json.loads(json.dumps(measures_dict(measured), allow_nan=False))
    assert table["supply"]["beyond"].keys() == {"20_um", "100_um", "150_um", "200_um"}
    assert table["printable"] == table["supply"]
    assert table["morphometry"]["artery"]["strahler"]["segments"] == [1]
    assert table["volume_mm3"] == pytest.approx(np.pi * LUMEN**2 * (LENGTH + 2))
    assert table["surface_mm2"] == pytest.approx(2 * np.pi * LUMEN * (LENGTH + 2))


def test_sections_count_the_vessels_that_cross_them(rod: Tissue) -> None:
    found = supply(straight(over=0.0), rod, samples=1000)
    area = rod.volume_mm3 / LENGTH
    np.testing.assert_allclose(found.sections_per_mm2, [0, 0, 1 / area], rtol=1e-9)
    assert found.vessels_per_mm2 == pytest.approx(0.5 / area)


# Terminals' supply compared with the demand of the tissue nearest to each.


ARTERY, VEIN, CONNECTION = VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION


@pytest.fixture(scope="module")
def box():
    return kept_tissue(block((20.0, 10.0, 10.0)))


def forked(kinds):
    """A fork in the middle, its ends at a quarter and three quarters, joined again beyond."""
    nodes = np.array([[10.0, 5, 0], [10, 5, 3], [5, 5, 5], [15, 5, 5], [10, 5, 8], [10, 5, 10]])
    ends = np.array([[0, 1], [1, 2], [1, 3], [2, 4], [3, 4], [4, 5]])[: len(kinds)]
    return network(nodes[: ends.max() + 1], ends, 0.2, kinds)


def test_a_tree_s_terminals_are_its_outlets(box):
    found = measure_territories(forked([ARTERY] * 3), box, np.array([4.0, 3.0, 1.0]), 1)
    assert found.terminals == 2
    assert found.worst == pytest.approx(0.5, rel=0.01)
    assert found.worst_at_mm == (15.0, 5.0, 5.0)


def test_in_a_closed_loop_they_are_where_arteries_end(box):
    kinds = [ARTERY, ARTERY, ARTERY, CONNECTION, VEIN, VEIN]
    flow = np.array([4.0, 2.0, 2.0, 2.0, 2.0, 4.0])
    found = measure_territories(forked(kinds), box, flow, 1)
    assert found.terminals == 2
    assert found.worst == pytest.approx(1.0, rel=0.01)


def test_all_measures_have_it_and_hand_it_on(box):
    options = MeasureOptions(samples=2000)
    flow = np.array([4.0, 3.0, 1.0])
    found = measure_network(forked([ARTERY] * 3), box, options, flow)
    table = measures_dict(found)["territories"]
    assert table["p5"] == pytest.approx(0.5, rel=0.01)
    assert table["worst_at_mm"] == [15.0, 5.0, 5.0]
    assert measure_network(forked([ARTERY] * 3), box, options).territories is None
    one = forked([ARTERY])
    assert measure_network(one, box, options, np.ones(1)).territories is None
