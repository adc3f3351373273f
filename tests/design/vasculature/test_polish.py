import itertools
from dataclasses import replace

import numba
import numpy as np
import pytest
from scipy.optimize import minimize

from design.errors import GrowthError
from design.network import VesselKind
from design.tissue import annulus, block, folded_cortex
from design.vasculature import GrowthOptions, RootSpec, grow_forest, grow_tree, tree_from_topology
from design.vasculature.polish.cost import tree_volume
from design.vasculature.polish.options import PolishOptions
from design.vasculature.polish.polish import find_faults, polish, polish_forest
from design.vasculature.polish.tree_polish import Bench
from design.vasculature.treemath import tree_radii
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature.test_grow import check
from tests.slower import first_of

SHAPES = {
    "hollow sphere": surfaces.hollow_sphere,
    "thin box": lambda: surfaces.thin_box(0.3),
    "block": lambda: block((20.0, 16.0, 12.0)),
    "annulus": lambda: annulus(30.0, 20.0, 6.0),
    "folded cortex": folded_cortex,
}


@pytest.fixture(scope="module")
def cube():
    return kept_tissue(block((10.0, 10.0, 10.0)))


@pytest.fixture(scope="module")
def grown(cube):
    return grow_tree(cube, GrowthOptions(terminals=200))


def tips(tree):
    """Terminals' ends, sorted."""
    ends = tree.distal[tree.children[:, 0] < 0]
    return ends[np.lexsort(ends.T)]


@pytest.mark.parametrize("name", first_of(SHAPES))
def test_polished_trees_are_smaller_and_still_fit(name):
    tissue = kept_tissue(SHAPES[name]())
    for seed in range(3):
        growth = GrowthOptions(terminals=60, seed=seed, clearance_mm=0.02)
        tree = grow_tree(tissue, growth)
        done = polish(tissue, tree, PolishOptions(seed=seed, clearance_mm=0.02))
        check(done.tree, tissue, growth)
        assert done.faults_after.collisions == done.faults_after.outside == 0
        assert done.faults_after.joint_overlaps <= done.faults_before.joint_overlaps
        assert done.volume_after < 0.99 * done.volume_before
        assert done.volume_after == pytest.approx(tree_volume(done.tree))
        np.testing.assert_array_equal(tips(done.tree), tips(tree))
        np.testing.assert_array_equal(done.tree.distal[0], tree.distal[0])


def test_grafts_save_more_than_relaxation_and_heat_more_than_none(cube, grown):
    relaxed = polish(cube, grown, PolishOptions(rounds=0))
    cold = polish(cube, grown, PolishOptions(heat=0.0))
    warm = polish(cube, grown, PolishOptions())
    assert relaxed.graft_moves == 0
    assert relaxed.cost_ratio == relaxed.relaxed_ratio < 0.99
    assert cold.cost_ratio < relaxed.cost_ratio
    assert warm.cost_ratio < cold.cost_ratio
    for done in (relaxed, cold, warm):
        assert done.cost_ratio == pytest.approx(done.volume_after / done.volume_before, rel=1e-9)


def test_same_bytes_for_the_same_seed_whatever_the_threads(cube, grown):
    options = PolishOptions(rounds=6)
    one = polish(cube, grown, options).tree
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        two = polish(cube, grown, options).tree
    finally:
        numba.set_num_threads(threads)
    assert one.distal.tobytes() == two.distal.tobytes()
    assert one.parent.tobytes() == two.parent.tobytes()
    other = polish(cube, grown, replace(options, seed=2)).tree
    assert one.distal.tobytes() != other.distal.tobytes()


def test_other_exponents_lower_their_own_cost(cube, grown):
    done = polish(cube, grown, PolishOptions(radius_exponent=1.0, rounds=4))
    assert done.cost_ratio < 0.99
    assert done.faults_after.collisions == done.faults_after.outside == 0


def test_what_comes_in_with_faults_does_not_leave_with_more(cube, grown):
    """Clearances wider than the tree was grown with can't all be met, nor may they get worse."""
    options = PolishOptions(clearance_mm=0.1, clearance_ratio=1.0, rounds=4)
    done = polish(cube, grown, options)
    assert done.faults_before.joint_overlaps > 0
    assert done.faults_before.outside > 0
    assert done.faults_before == find_faults(cube, grown, options)
    assert done.faults_after.no_worse_than(done.faults_before)
    assert done.volume_after <= done.volume_before


def test_vessels_that_grew_too_wide_are_made_to_fit(cube):
    """All radii a little wider, at a lower pressure drop: some vessels collide until mended."""
    grown = grow_tree(cube, GrowthOptions(terminals=1000))
    tree = replace(grown, pressure_drop_pa=grown.pressure_drop_pa / 1.1**4)
    before = find_faults(cube, tree, PolishOptions())
    assert before.collisions + before.joint_overlaps > 0
    bench = Bench.open(cube, tree, PolishOptions())
    assert bench.most_wide > 0
    bench.most_wide = 0
    assert bench.mended()
    after = find_faults(cube, bench.tree(), PolishOptions())
    assert after.collisions == after.joint_overlaps == after.outside == 0
    np.testing.assert_array_equal(tips(bench.tree()), tips(tree))


def test_a_polished_tree_is_not_made_dearer(cube, grown):
    once = polish(cube, grown, PolishOptions(rounds=8))
    twice = polish(cube, once.tree, PolishOptions(rounds=8, heat=0.0))
    assert twice.volume_after <= once.volume_after


@pytest.mark.parametrize("terminals", [1, 2])
def test_trees_with_nothing_to_move_come_back_as_they_are(cube, terminals):
    tree = grow_tree(cube, GrowthOptions(terminals=terminals))
    done = polish(cube, tree, PolishOptions())
    np.testing.assert_array_equal(done.tree.distal, tree.distal)
    assert done.cost_ratio == 1.0


def three(order, tip, b):
    """A stem, a branch point at ``b`` that feeds the first two of ``order``, and the third."""
    far = np.array([[5.0, 5, 8], b, tip[order[2]], tip[order[0]], tip[order[1]]])
    parent = np.array([-1, 0, 0, 1, 1], dtype=np.int32)
    near = np.array([[5.0, 5, 10], *far[parent[1:]]])
    children = np.array([[1, 2], [3, 4], [-1, -1], [-1, -1], [-1, -1]], dtype=np.int32)
    return tree_from_topology(
        near,
        far,
        parent,
        children,
        flow_ul_s=1.0,
        pressure_drop_pa=5000.0,
        murray_exponent=3.0,
        viscosity_pa_s=4e-3,
    )


def test_three_terminals_end_in_the_best_of_all_trees(cube):
    """Every topology with its branch point where a general optimiser puts it."""
    tip = np.array([[2.0, 3, 2], [3.0, 3.5, 1.5], [8.0, 7, 3]])
    volumes = {}
    for order in itertools.combinations(range(3), 2):
        rest = (*order, 3 - sum(order))
        start = np.append(tip[list(order)], [[5.0, 5, 8]], axis=0).mean(axis=0)
        found = minimize(
            lambda b, rest=rest: tree_volume(three(rest, tip, b)), start, method="Nelder-Mead"
        )
        volumes[rest] = found.fun
    worst = max(volumes, key=volumes.__getitem__)
    done = polish(cube, three(worst, tip, tip.mean(axis=0)), PolishOptions(tolerance=0.0))
    assert done.graft_moves > 0
    assert max(volumes.values()) > 1.1 * min(volumes.values())
    assert done.volume_after == pytest.approx(min(volumes.values()), rel=2e-3)


def test_absurd_options_are_refused():
    with pytest.raises(GrowthError, match="heat is -1; give a value from 0 to 100"):
        PolishOptions(heat=-1.0)
    with pytest.raises(GrowthError, match="rounds is 5000"):
        PolishOptions(rounds=5000)


def test_trees_of_a_forest_are_polished_clear_of_each_other():
    tissue = kept_tissue(block((20.0, 16.0, 12.0)))
    growth = GrowthOptions(terminals=60, clearance_mm=0.05)
    trees = grow_forest(tissue, [RootSpec(growth), RootSpec(growth, VesselKind.VEIN)])
    alone = polish(tissue, trees[0], PolishOptions(clearance_mm=0.05)).tree
    assert gaps([alone, trees[1]]) < 0.05, "polished by itself it runs into the other"
    done = polish_forest(tissue, trees, PolishOptions(clearance_mm=0.05))
    assert gaps([one.tree for one in done]) > 0.05 - 1e-9
    for tree, polished in zip(trees, done, strict=True):
        check(polished.tree, tissue, growth)
        np.testing.assert_array_equal(tips(polished.tree), tips(tree))
        assert polished.volume_after < 0.97 * polished.volume_before


def gaps(trees):
    """Least distance of two trees' walls, by closest points of all pairs of axes."""
    first, second = trees
    a, b = (tree.distal - tree.proximal for tree in trees)
    least = np.inf
    for i, radius in enumerate(tree_radii(first)):
        for t in np.linspace(0, 1, 21):
            off = first.proximal[i] + t * a[i] - second.proximal
            s = np.clip((off * b).sum(axis=1) / (b * b).sum(axis=1), 0, 1)
            away = np.linalg.norm(off - s[:, None] * b, axis=1)
            least = min(least, float((away - tree_radii(second)).min() - radius))
    return least
