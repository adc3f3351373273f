"""User-given terminals: all reached, or reported."""

import numpy as np
import pytest

from design.errors import GrowthError
from design.tissue import block
from design.vasculature import (
    GrowthOptions,
    collisions,
    forest_to_network,
    grow_forest,
    grow_tree,
    supply_balance,
    tree_radii,
    tree_to_network,
)
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles
from tests.slower import first_of

WELLS = np.array([(x, y, 6.0) for x in np.arange(2, 20, 2.5) for y in np.arange(2, 16, 2.5)])


@pytest.fixture(scope="module")
def box():
    shape = block((20.0, 16.0, 12.0))
    return kept_tissue(shape)


def tips_of(tree):
    return tree.distal[tree.children[:, 0] < 0]


def in_order(points):
    return points[np.lexsort(points.T)]


@pytest.mark.parametrize("seed", first_of(range(4)))
@pytest.mark.parametrize("printed", [{}, {"smallest_radius_mm": 0.1}])
def test_every_well_of_a_plate_is_reached(box, seed, printed):
    options = GrowthOptions(terminal_points_mm=WELLS, seed=seed, clearance_mm=0.1, **printed)
    assert options.terminals == len(WELLS)
    tree = grow_tree(box, options)
    np.testing.assert_array_equal(in_order(tips_of(tree)), in_order(WELLS))
    assert collisions(tree_to_network(tree), 0.1, options.clearance_ratio).count == 0
    flows = oracles.terminal_flows(tree, tree_radii(tree))
    assert np.ptp(flows) < 1e-9 * flows.mean()


def test_given_flows_are_what_an_independent_solver_finds(box):
    rng = np.random.default_rng(0)
    points, asked = rng.uniform([1, 1, 1], [19, 15, 11], (300, 3)), rng.uniform(0.2, 3, 300)
    options = GrowthOptions(terminal_points_mm=points, terminal_flows=asked)
    tree = grow_tree(box, options)
    flow_at = {tuple(p): q for p, q in zip(points.tolist(), asked.tolist(), strict=True)}
    expected = np.array([flow_at[tuple(tip)] for tip in tips_of(tree).tolist()])
    found = oracles.terminal_flows(tree, tree_radii(tree))
    total = options.flow_ul_s(box.volume_mm3)
    np.testing.assert_allclose(found, expected * total / expected.sum(), rtol=1e-9)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"terminal_points_mm": []}, "at least one point"),
        ({"terminal_points_mm": [[1, 2, 3], [1, 2, 3]]}, "names a point twice"),
        ({"terminal_points_mm": [[1, 2], [3, 4]]}, "three finite numbers"),
        ({"terminal_points_mm": [[1, 2, 3], [3, 4, 5]], "terminal_flows": [1.0]}, "flow above 0"),
        ({"terminal_points_mm": [[1, 2, 3], [3, 4, 5]], "terminal_flows": [1, 0]}, "flow above 0"),
    ],
)
def test_impossible_points_are_refused(asked, message):
    with pytest.raises(GrowthError, match=message):
        GrowthOptions(**asked)


@pytest.mark.slow
def test_forests_keep_given_flows(box):
    rng = np.random.default_rng(1)
    points, asked = rng.uniform([1, 1, 1], [19, 15, 11], (120, 3)), rng.uniform(0.2, 3, 120)
    options = GrowthOptions(terminal_points_mm=points, terminal_flows=asked, clearance_mm=0.02)
    flow_at = {tuple(p): q for p, q in zip(points.tolist(), asked.tolist(), strict=True)}
    total = options.flow_ul_s(box.volume_mm3)
    vein = GrowthOptions(terminals=120, clearance_mm=0.02, terminal_flow="demand")
    artery, drain = grow_forest(box, [options, vein])
    expected = np.array([flow_at[tuple(tip)] for tip in tips_of(artery).tolist()])
    found = oracles.terminal_flows(artery, tree_radii(artery))
    np.testing.assert_allclose(found, expected * total / expected.sum(), rtol=1e-9)
    tips = drain.children[:, 0] < 0
    assert supply_balance(box, drain.distal[tips], drain.flow_ul_s[tips]).spread < 0.05
    both = forest_to_network([artery, drain])
    assert collisions(both, 0.02, options.clearance_ratio).count == 0


def test_points_outside_are_told_with_number_and_place(box):
    points = [[5, 5, 5], [10, 8, 30], [9, 8, 6]]
    with pytest.raises(GrowthError, match=r"1 of 3 given.*outside.*number 1 at \(10, 8, 30\)"):
        grow_tree(box, GrowthOptions(terminal_points_mm=points))


def test_a_point_that_no_vessel_fits_at_is_named(box):
    points = np.concatenate([WELLS, [[10.0, 8.0, 0.02]]])
    with pytest.raises(GrowthError, match=r"1 of 49 given.*can't be joined.*10, 8, 0\.02.*0\.02"):
        grow_tree(box, GrowthOptions(terminal_points_mm=points, smallest_radius_mm=0.1), attempts=1)
