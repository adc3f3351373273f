"""Trees for every part of a tissue, and the check of what each part gets."""

from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

from design.errors import GrowthError, TissueError
from design.tissue import depth_demand, function_demand, part_demands, parts_of
from design.tissue.zones import surface_of
from design.vasculature import (
    DepthPenalty,
    GrowthOptions,
    Inlet,
    check_supply,
    grow_parts,
    grow_tree,
    parts_to_network,
    terminals_of,
    tree_radii,
)
from design.vasculature.growth.supply import demand_points, territory_demand, unreached
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles

OPTIONS = GrowthOptions(terminals=60)
LARGE = Manifold.cube((10.0, 10.0, 10.0))
SMALL = Manifold.cube((6.0, 6.0, 6.0)).translate((20.0, 0.0, 0.0))


def _tissue(whole):
    return kept_tissue(surface_of(whole, "the test's tissue"))


@pytest.fixture(scope="module")
def two():
    return _tissue(LARGE + SMALL)


@pytest.fixture(scope="module")
def dumbbell():
    """Two balls, the neck between them thinner than a vessel."""
    ball, neck = Manifold.sphere(6.0, 48), Manifold.cube((4.0, 0.1, 0.1))
    other = Manifold.sphere(5.0, 48).translate((12.5, 0.0, 0.0))
    return _tissue(ball + neck.translate((5.0, -0.05, -0.05)) + other)


def test_each_part_gets_vessels_and_flow_by_its_volume(two):
    grown = grow_parts(two, OPTIONS)
    assert len(grown.trees) == 2
    assert [one.terminals for one in grown.supply] == [49, 11]
    for one in grown.supply:
        assert one.flow_share == pytest.approx(one.demand_share, rel=1e-9)
    assert len(parts_to_network(grown).outlets()) == 60
    assert "2 separate parts, each with vessels (1e+03 mm³: 49 terminals" in grown.notes[-1]
    assert grow_parts(two, OPTIONS).trees[1].distal.tolist() == grown.trees[1].distal.tolist()


def test_demand_of_a_part_sets_its_share_and_one_without_an_inlet_is_refused(two):
    deep = replace(two, demand=depth_demand(two, [0.0, 3.0, 3.5], [0.0, 0.0, 1.0]))
    demand = part_demands(deep, parts_of(deep))
    assert demand.tolist() == [1.0, 0.0]
    grown = grow_parts(deep, OPTIONS)
    assert [one.terminals for one in grown.supply] == [60, 0]
    with pytest.raises(TissueError, match=r"no vessel ends in the part of 216 mm³ around \(23, 3"):
        grow_parts(two, OPTIONS, [Inlet((5.0, 5.0, 10.0))])


def test_a_lobe_behind_a_neck_gets_an_inlet_of_its_own_or_is_told(dumbbell):
    grown = grow_parts(dumbbell, OPTIONS)
    ends, _ = terminals_of(grown.trees)
    assert len(ends) == 60
    share = float((ends[:, 0] > 6.5).mean())
    assert share == pytest.approx(125 / (216 + 125), abs=0.06)
    assert "1 more were added" in grown.notes[0]
    tree = grow_tree(dumbbell, OPTIONS)
    supply, notes = check_supply(dumbbell, *terminals_of([tree]))
    assert len(supply) == 1
    assert "none ends in the" in notes[0]
    assert "mm³ around (" in notes[0]


def _box(low, high, apart):
    """Points of a lattice between two corners."""
    ends = [np.arange(a + apart / 2, b, apart) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("by_demand", [True, False])
def test_terminals_as_far_apart_as_demand_asks_for_reach_all(by_demand):
    tissue = _tissue(Manifold.cube((64.0, 16.0, 16.0)))
    ends = np.concatenate([_box((0, 0, 0), (32, 16, 16), 2), _box((32, 0, 0), (64, 16, 16), 8)])
    if by_demand:
        uneven = function_demand(tissue, lambda points: np.where(points[:, 0] < 32, 1.0, 1 / 64))
        tissue = replace(tissue, demand=uneven)
    assert (unreached(tissue, ends) == ()) == by_demand


# Terminals and flows distributed by the tissue's demand.

SIZE = (20.0, 16.0, 12.0)


@pytest.fixture(scope="module")
def uneven(box):
    """The half of small x asks for four times as much."""
    return replace(box, demand=function_demand(box, lambda p: np.where(p[:, 0] < 10, 4.0, 1.0)))


def tips_of(tree):
    return tree.distal[tree.children[:, 0] < 0]


def tip_flows(tree):
    return tree.flow_ul_s[tree.children[:, 0] < 0]


def test_terminals_are_denser_where_demand_is_higher(box, uneven):
    options = GrowthOptions(terminals=500)
    rich = (tips_of(grow_tree(uneven, options))[:, 0] < 10).mean()
    plain = (tips_of(grow_tree(box, options))[:, 0] < 10).mean()
    assert rich == pytest.approx(0.8, abs=0.05)
    assert plain == pytest.approx(0.5, abs=0.05)


def test_demand_is_ignored_where_the_user_says_so(box, uneven):
    options = GrowthOptions(terminals=200, follow_demand=False)
    one, two = grow_tree(box, options), grow_tree(uneven, options)
    np.testing.assert_array_equal(one.distal, two.distal)


def test_flows_by_demand_are_what_an_independent_solver_finds(uneven):
    options = GrowthOptions(terminals=300, terminal_flow="demand", clearance_mm=0.02)
    tree = grow_tree(uneven, options)
    flows = oracles.terminal_flows(tree, tree_radii(tree))
    np.testing.assert_allclose(flows, tip_flows(tree), rtol=1e-9)
    assert flows.sum() == pytest.approx(options.flow_ul_s(uneven.volume_mm3))
    assert np.ptp(flows) > 2 * flows.mean()


# Position penalty on branch points.


def joints_of(tree):
    inner = tree.children[:, 0] >= 0
    # The stem's end is where the root's place puts it.
    inner[0] = False
    return tree.distal[inner]


def test_branch_points_keep_away_from_the_surface(box):
    depth = [
        -box.grid.distance(
            joints_of(
                grow_tree(box, GrowthOptions(terminals=200, penalty=penalty, root_at_top=True))
            )
        )
        for penalty in (None, DepthPenalty((0.0, 2.0), (5.0, 1.0)))
    ]
    assert np.percentile(depth[0], 20) < 1.6
    assert np.percentile(depth[1], 5) > 1.8


@pytest.mark.parametrize(
    ("depth", "factor", "message"),
    [
        ((0.0, 1.0), (1.0,), "2 depths and 1 factors"),
        ((1.0, 0.5), (1.0, 2.0), "doesn't ascend"),
        ((0.0, 1.0), (1.0, 0.0), "factor of 0"),
    ],
)
def test_impossible_tables_are_refused(depth, factor, message):
    with pytest.raises(GrowthError, match=message):
        DepthPenalty(depth, factor)


def test_impossible_functions_are_refused(box):
    with pytest.raises(GrowthError, match="factor of -1"):
        grow_tree(box, GrowthOptions(terminals=5, penalty=lambda p: np.full(len(p), -1.0)))
    with pytest.raises(GrowthError, match="shape"):
        grow_tree(box, GrowthOptions(terminals=5, penalty=lambda p: p))


def test_territories_are_those_of_a_grid_of_terminals(box):
    """On a regular grid every territory is a box; its demand is an integral done by hand."""
    axes = [np.arange(s / 8, s, s / 4) for s in SIZE]
    tips = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    linear = replace(box, demand=function_demand(box, lambda p: 1.0 + p[:, 0]))
    points, weight = demand_points(linear, 200_000, 3)
    expected = (1 + tips[:, 0]) / (1 + tips[:, 0]).sum()
    np.testing.assert_allclose(territory_demand(points, weight, tips), expected, rtol=0.02)
