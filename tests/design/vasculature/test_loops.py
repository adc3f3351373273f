import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from design.errors import GrowthError, NetworkError
from design.hemodynamics import FlowConditions, flow_spread, solve_flow
from design.network import VesselKind
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.tissue import block
from design.vasculature import (
    GrowthOptions,
    LoopOptions,
    RootSpec,
    close_loops,
    collisions,
    grow_forest,
    grow_tree,
)
from design.vasculature.loops.curves import tightest_bend
from design.vasculature.loops.loops import match_terminals
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles

COUNT = 40


@pytest.fixture(scope="module")
def tissue():
    return kept_tissue(block((20.0, 16.0, 12.0)))


def pair(tissue, seed=1, count=COUNT):
    options = GrowthOptions(terminals=count, seed=seed)
    return grow_forest(tissue, [RootSpec(options), RootSpec(options, VesselKind.VEIN)])


@pytest.fixture(scope="module")
def closed(tissue):
    return close_loops(tissue, *pair(tissue)).network


def test_every_terminal_is_joined_once(closed):
    assert (closed.kind == VesselKind.CONNECTION).sum() == COUNT
    assert len(closed.inlets()) == len(closed.outlets()) == 1
    joined = closed.vessel_nodes[closed.kind == VesselKind.CONNECTION]
    assert len(np.unique(joined)) == 2 * COUNT
    assert (closed.degree()[joined] == 2).all()
    for vessel in range(closed.vessel_count):
        points, _ = closed.polyline(vessel)
        np.testing.assert_allclose(
            points[[0, -1]], closed.nodes[closed.vessel_nodes[vessel]], atol=1e-12
        )


@pytest.mark.parametrize("seed", [pytest.param(2, marks=pytest.mark.slow), 3])
def test_loops_in_a_torus_keep_clear_and_inside(seed):
    tissue = kept_tissue(surfaces.torus())
    network = close_loops(tissue, *pair(tissue, seed)).network
    check(network, tissue)


def check(network, tissue):
    assert collisions(network, 0.0, 0.1).count == 0
    start, end, r0, r1, vessel = network.pieces()
    roots = np.concatenate([network.inlets(), network.outlets()])
    stem = np.isin(network.vessel_nodes, roots).any(axis=1)[vessel]
    radius = np.maximum(r0, r1)
    assert tissue.grid.capsule_inside(start, end, radius)[~stem].all()
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=1.0)
    assert flow_spread(network, conditions) < 1e-9
    assert solve_flow(network, conditions).flow.min() > 0


def test_oracle_finds_no_collision_either(tissue):
    network = close_loops(tissue, *pair(tissue, count=12)).network
    assert oracles.colliding_pairs(network, 0.0, 0.1)[0] == set()


def test_connections_turn_gently(closed):
    options = LoopOptions()
    for vessel in np.flatnonzero(closed.kind == VesselKind.CONNECTION):
        points, radius = closed.polyline(int(vessel))
        step = np.diff(points, axis=0)
        length = np.linalg.norm(step, axis=1)
        unit = step / length[:, None]
        turn = np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1, 1))
        # The chord's turn is the arc's length over the bend radius at most.
        arc = 0.5 * (length[1:] + length[:-1])
        assert (turn <= 1.1 * arc / (options.bend_to_radius * radius[0]) + 1e-9).all()


def test_exported_loops_carry_equal_flow(closed, tmp_path):
    write_network_csv(tmp_path / "network.csv", closed)
    back = read_network_csv(tmp_path / "network.csv", "mm")
    assert flow_spread(back, FlowConditions(4e-3, inlet_flow_ul_s=1.0)) < 1e-9


@pytest.mark.slow
def test_several_trees_of_a_side_mix(tissue):
    settings = [
        RootSpec(GrowthOptions(terminals=20, root_point_mm=(3.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=10, root_point_mm=(17.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=30), VesselKind.VEIN),
    ]
    left, right, vein = grow_forest(tissue, settings)
    network = close_loops(tissue, [left, right], vein).network
    assert len(network.inlets()) == 2
    assert len(network.outlets()) == 1
    assert collisions(network, 0.0, 0.1).count == 0


def test_unequal_sides_are_refused(tissue):
    artery, _ = pair(tissue)
    with pytest.raises(GrowthError, match="40 arterial terminals can't be matched to 10"):
        close_loops(tissue, artery, grow_tree(tissue, GrowthOptions(terminals=10, seed=5)))


def test_trees_that_collide_are_refused(tissue):
    one = grow_tree(tissue, GrowthOptions(terminals=COUNT, seed=1))
    two = grow_tree(tissue, GrowthOptions(terminals=COUNT, seed=2))
    with pytest.raises((NetworkError, GrowthError), match=r"colliding pairs|found no way"):
        close_loops(tissue, one, two)


def test_option_out_of_range_is_refused():
    with pytest.raises(GrowthError, match=r"bend_to_radius is 0\.5"):
        LoopOptions(bend_to_radius=0.5)


def test_matching_is_as_good_as_the_dense_one(tissue):
    random = np.random.default_rng(3)
    one, other = random.uniform(1, 11, (2, 60, 3))
    partner = match_terminals(tissue, one, other)
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    rows, columns = linear_sum_assignment(apart)
    best = apart[rows, columns].sum()
    assert apart[np.arange(60), partner].sum() == pytest.approx(best, rel=0.02)
    assert sorted(partner) == list(range(60))


def test_bend_of_a_quarter_circle():
    k = 0.5522847498
    quarter = np.array([[1.0, 0, 0], [1, k, 0], [k, 1, 0], [0, 1, 0]])
    assert tightest_bend(3.0 * quarter) == pytest.approx(3.0, rel=0.01)
