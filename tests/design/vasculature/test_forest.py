"""Forests: arteries and veins apart, closed to loops, mixed at shared nodes."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from design.errors import GrowthError, NetworkError
from design.hemodynamics import FlowConditions, balance, flow_spread, solve_flow
from design.network import VesselKind
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.vasculature import (
    GrowthOptions,
    LoopOptions,
    RootSpec,
    close_loops,
    collisions,
    forest_to_network,
    grow_forest,
    grow_tree,
    mix_trees,
    tree_radii,
)
from design.vasculature.growth.territories import part_tissue
from design.vasculature.loops.connect import Connections
from design.vasculature.loops.curves import tightest_bend
from design.vasculature.loops.loops import match_terminals, refuse_blocked
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles
from tests.slower import first_of


@pytest.fixture(scope="module")
def tissues(box):
    return {
        "block": box,
        "torus": kept_tissue(surfaces.torus()),
        "hollow sphere": kept_tissue(surfaces.hollow_sphere()),
    }


def pair(count, seed=1, clearance_mm=0.0):
    options = GrowthOptions(terminals=count, seed=seed, clearance_mm=clearance_mm)
    return [RootSpec(options), RootSpec(options, VesselKind.VEIN)]


@pytest.mark.parametrize("seed", first_of(range(5)))
@pytest.mark.parametrize("name", ["block", "torus", "hollow sphere"])
def test_artery_and_vein_pervade_a_tissue_without_touching(tissues, name, seed):
    trees = grow_forest(tissues[name], pair(30, seed, 0.02))
    network = forest_to_network(trees, [VesselKind.ARTERY, VesselKind.VEIN])
    assert collisions(network, 0.02, 0.1).count == 0
    if seed == 0:
        assert oracles.colliding_pairs(network, 0.02, 0.1)[0] == set()
    for tree in trees:
        assert int((tree.children[:, 0] < 0).sum()) == 30
        flows = oracles.terminal_flows(tree, tree_radii(tree))
        assert np.ptp(flows) < 1e-9 * flows.mean()
        radius = tree_radii(tree)[1:]
        assert tissues[name].grid.capsule_inside(tree.proximal[1:], tree.distal[1:], radius).all()


def test_veins_flow_towards_their_root(box):
    trees = grow_forest(box, pair(20))
    network = forest_to_network(trees, [VesselKind.ARTERY, VesselKind.VEIN])
    roots = np.array([tree.proximal[0] for tree in trees])
    inlets, outlets = network.inlets(), network.outlets()
    assert (network.nodes[inlets] == roots[0]).all(axis=1).any()
    assert (network.nodes[outlets] == roots[1]).all(axis=1).any()
    assert len(inlets) == len(outlets) == 21


def test_roots_of_a_kind_share_the_tissue_by_their_terminals(box):
    settings = [
        RootSpec(GrowthOptions(terminals=90, root_point_mm=(3.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=30, root_point_mm=(17.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=60), VesselKind.VEIN),
    ]
    left, right, vein = grow_forest(box, settings)
    assert left.terminal_flow_ul_s == pytest.approx(right.terminal_flow_ul_s)
    total = 90 * left.terminal_flow_ul_s + 30 * right.terminal_flow_ul_s
    assert total == pytest.approx(60 * vein.terminal_flow_ul_s)
    # The border is a plane across x; three quarters of 20 mm are to its left.
    tips = [tree.distal[tree.children[:, 0] < 0, 0] for tree in (left, right)]
    assert tips[0].max() < tips[1].min() + 0.5
    assert tips[0].max() == pytest.approx(15.0, abs=1.0)


def test_bad_forests_are_refused(box):
    with pytest.raises(GrowthError, match="no roots"):
        grow_forest(box, [])
    far = GrowthOptions(terminals=5, root_point_mm=(200.0, 0, 0), root_direction=(-1.0, 0, 0))
    with pytest.raises(GrowthError, match="never enters the tissue"):
        grow_forest(box, [far])
    same = GrowthOptions(terminals=5, root_point_mm=(10.0, 8.0, 0.0))
    with pytest.raises(GrowthError, match="meets another tree"):
        grow_forest(box, [same, same])


def test_territories_have_the_volumes_wanted(tissues):
    tissue = tissues["torus"]
    centre = np.array([[8.0, 0, 0], [-4.0, 6.5, 0], [-4.0, -6.5, 0]])
    wanted = np.array([0.2, 0.3, 0.5])
    parts = part_tissue(tissue, centre, wanted)
    np.testing.assert_allclose(parts.share, wanted, atol=5e-3)
    low, high = tissue.bounds
    points = np.random.default_rng(5).uniform(low, high, (60_000, 3))
    inside = points[tissue.contains(points)]
    share = [parts.owns(n)(inside).mean() for n in range(3)]
    np.testing.assert_allclose(share, wanted, atol=0.02)


# Loops: terminals joined.


COUNT = 40


def grown_pair(box, seed=1, count=COUNT):
    options = GrowthOptions(terminals=count, seed=seed)
    return grow_forest(box, [RootSpec(options), RootSpec(options, VesselKind.VEIN)])


@pytest.fixture(scope="module")
def closed(box):
    return close_loops(box, *grown_pair(box)).network


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
    box = kept_tissue(surfaces.torus())
    network = close_loops(box, *grown_pair(box, seed)).network
    check(network, box)


def check(network, box):
    assert collisions(network, 0.0, 0.1).count == 0
    start, end, r0, r1, vessel = network.pieces()
    roots = np.concatenate([network.inlets(), network.outlets()])
    stem = np.isin(network.vessel_nodes, roots).any(axis=1)[vessel]
    radius = np.maximum(r0, r1)
    assert box.grid.capsule_inside(start, end, radius)[~stem].all()
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=1.0)
    assert flow_spread(network, conditions) < 1e-9
    assert solve_flow(network, conditions).flow.min() > 0


def test_oracle_finds_no_collision_either(box):
    network = close_loops(box, *grown_pair(box, count=12)).network
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
def test_several_trees_of_a_side_mix(box):
    settings = [
        RootSpec(GrowthOptions(terminals=20, root_point_mm=(3.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=10, root_point_mm=(17.0, 8.0, 0.0))),
        RootSpec(GrowthOptions(terminals=30), VesselKind.VEIN),
    ]
    left, right, vein = grow_forest(box, settings)
    network = close_loops(box, [left, right], vein).network
    assert len(network.inlets()) == 2
    assert len(network.outlets()) == 1
    assert collisions(network, 0.0, 0.1).count == 0


def test_unequal_sides_colliding_trees_and_impossible_options_are_refused(box):
    artery, _ = grown_pair(box)
    with pytest.raises(GrowthError, match="40 arterial terminals can't be matched to 10"):
        close_loops(box, artery, grow_tree(box, GrowthOptions(terminals=10, seed=5)))
    one = grow_tree(box, GrowthOptions(terminals=COUNT, seed=1))
    two = grow_tree(box, GrowthOptions(terminals=COUNT, seed=2))
    with pytest.raises((NetworkError, GrowthError), match=r"colliding pairs|found no way"):
        close_loops(box, one, two)
    with pytest.raises(GrowthError, match=r"bend_to_radius is 0\.5"):
        LoopOptions(bend_to_radius=0.5)


def test_matching_is_as_good_as_the_dense_one(box):
    random = np.random.default_rng(3)
    one, other = random.uniform(1, 11, (2, 60, 3))
    partner = match_terminals(box, one, other)
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    rows, columns = linear_sum_assignment(apart)
    best = apart[rows, columns].sum()
    assert apart[np.arange(60), partner].sum() == pytest.approx(best, rel=0.02)
    assert sorted(partner) == list(range(60))


def test_bend_of_a_quarter_circle():
    k = 0.5522847498
    quarter = np.array([[1.0, 0, 0], [1, k, 0], [k, 1, 0], [0, 1, 0]])
    assert tightest_bend(3.0 * quarter) == pytest.approx(3.0, rel=0.01)


# Terminals that find no way.


@pytest.fixture(scope="module")
def torus():
    shape = surfaces.torus()
    return kept_tissue(shape)


def test_a_few_that_find_no_way_are_pruned_and_counted(torus, monkeypatch):
    settings = GrowthOptions(terminals=40)
    trees = grow_forest(torus, [RootSpec(settings), RootSpec(settings, VesselKind.VEIN)])
    whole = close_loops(torus, *trees)
    assert (whole.connections, whole.pruned) == (40, 0)
    join_all = Connections.join_all

    def all_but_two(joins):
        join_all(joins)
        for number in (3, 17):
            joins.remove(number)

    monkeypatch.setattr(Connections, "join_all", all_but_two)
    with pytest.raises(GrowthError, match=r"2 of 40 connections found no path .* \(0 may be"):
        close_loops(torus, *trees)
    fewer = close_loops(torus, *trees, LoopOptions(prune_part=0.05))
    assert (fewer.connections, fewer.pruned) == (38, 2)
    network = fewer.network
    assert (network.kind == VesselKind.CONNECTION).sum() == 38
    assert len(network.inlets()) == len(network.outlets()) == 1
    assert collisions(network, 0.0, 0.1).count == 0
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=1.0)
    assert flow_spread(network, conditions) > 1e-3
    narrowed = balance(network, conditions, widen=False)
    assert flow_spread(narrowed, conditions) < 1e-9
    assert collisions(narrowed, 0.0, 0.1).count == 0


# Mixing networks: three and four trees at shared nodes.


A, V, L = VesselKind.ARTERY, VesselKind.VEIN, VesselKind.LYMPH
EACH = 24


def grown(box, kinds, counts=None, seed=1):
    counts = counts or [EACH] * len(kinds)
    # Bare options: the two arteries pervade the whole tissue, so that each node gets both.
    return grow_forest(
        box,
        [
            RootSpec(GrowthOptions(terminals=n, seed=seed), kind)
            if kinds.count(kind) == 1
            else GrowthOptions(terminals=n, seed=seed)
            for kind, n in zip(kinds, counts, strict=True)
        ],
    )


@pytest.mark.parametrize("kinds", first_of([[A, A, V], [A, V, L], [A, V, A, V]]), ids=str)
def test_every_node_mixes_all_trees_in_equal_shares(box, kinds):
    mixed = mix_trees(box, grown(box, kinds), kinds)
    network = mixed.network
    assert mixed.connections == EACH
    assert len(network.inlets()) == kinds.count(A)
    assert len(network.outlets()) == len(kinds) - kinds.count(A)
    limbs = network.kind == VesselKind.CONNECTION
    assert limbs.sum() == len(kinds) * EACH
    if len(kinds) > 3:
        assert (network.degree() == len(kinds)).sum() == EACH
    assert collisions(network, 0.0, 0.1).count == 0
    start, end, r0, r1, vessel = network.pieces()
    roots = np.concatenate([network.inlets(), network.outlets()])
    stem = np.isin(network.vessel_nodes, roots).any(axis=1)[vessel]
    assert box.grid.capsule_inside(start, end, np.maximum(r0, r1))[~stem].all()
    flow = solve_flow(network, FlowConditions(4e-3, inlet_pressure_pa=5e3)).flow
    assert flow.min() > 0
    for of_one in flow[limbs].reshape(len(kinds), EACH):
        np.testing.assert_allclose(of_one, of_one.mean(), rtol=1e-9)


@pytest.mark.parametrize(
    ("kinds", "counts", "message"),
    [
        ([A, V], [4, 4], "2 trees of 2 kinds can't be mixed"),
        ([A, A, V], [4, 5, 4], "trees of 4, 5, 4 terminals"),
        ([A, A, A], [4, 4, 4], "kinds given are artery, artery, artery"),
    ],
)
def test_what_cannot_be_mixed_is_refused(box, kinds, counts, message):
    trees = grow_forest(box, [GrowthOptions(terminals=n, seed=1) for n in counts])
    with pytest.raises(GrowthError, match=message):
        mix_trees(box, trees, kinds)


@pytest.mark.parametrize(("apart", "named"), [(9.0, True), (2.0, False)])
def test_blocked_partners_far_apart_name_the_territories(apart: float, named: bool) -> None:
    """Divided arteries and veins that lie elsewhere aren't brought together by less clearance."""
    here = 1.8 * np.indices((3, 3, 3)).reshape(3, -1).T
    joins = SimpleNamespace(
        one=SimpleNamespace(point=here),
        other=SimpleNamespace(point=here + [apart, 0.0, 0.0]),
        partner=np.arange(27),
        radius=np.zeros(27),
        blocked=[4],
    )
    with pytest.raises(GrowthError, match="1 of 27 connections found no path") as refused:
        refuse_blocked(joins, 0, LoopOptions())  # type: ignore[arg-type]
    assert ("9 mm apart in the median" in str(refused.value)) == named
    assert ("territories by_network or whole" in str(refused.value)) == named
