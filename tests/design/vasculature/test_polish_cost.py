import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from design.vasculature.growth.state import place, refresh, refresh_upwards, spread_down
from design.vasculature.options import GrowthOptions, Law
from design.vasculature.polish.cost import tree_volume
from design.vasculature.polish.graft import fork_cost
from design.vasculature.polish.relax import best_node, node_value, root_radius
from design.vasculature.polish.topology import attach, cut_branch, detach, is_below, undo_cut
from design.vasculature.treemath import tree_from_topology, tree_radii
from tests.design.vasculature.test_cost import as_tree, laws, random_segments
from tests.slower import examples

FLOW, DROP = 10.0, 5000.0


def moved(tree, i, step):
    """The tree with the far end of segment i moved, all else derived anew."""
    proximal, distal = tree.proximal.copy(), tree.distal.copy()
    distal[i] += step
    for child in tree.children[i]:
        if child >= 0:
            proximal[child] += step
    return tree_from_topology(
        proximal,
        distal,
        tree.parent,
        tree.children,
        flow_ul_s=FLOW,
        pressure_drop_pa=DROP,
        murray_exponent=tree.murray_exponent,
        viscosity_pa_s=tree.viscosity_pa_s,
    )


def spread_segments(seed, terminals, law):
    """Random segments with the radii and derivatives that go with `FLOW` and `DROP`."""
    segments, count = random_segments(seed, terminals, law)
    segments = segments[:count].copy()
    spread_down(segments, count, root_radius(segments, FLOW / DROP), 1.0, law)
    return segments


def test_volume_is_the_sum_of_its_cylinders():
    options = GrowthOptions()
    segments, count = random_segments(3, 9, options.law)
    tree = as_tree(segments, count, options)
    cylinders = [
        np.pi * r**2 * np.linalg.norm(b - a)
        for a, b, r in zip(tree.proximal, tree.distal, tree_radii(tree), strict=True)
    ]
    assert tree_volume(tree) == pytest.approx(sum(cylinders), rel=1e-13)


@settings(deadline=None, max_examples=examples(30))
@given(laws, st.integers(0, 10_000), st.integers(3, 25))
def test_a_trial_node_has_the_cost_and_radii_of_the_tree_built_anew(options, seed, terminals):
    law = options.law
    segments = spread_segments(seed, terminals, law)
    inner = np.flatnonzero(segments["left"] >= 0)
    i = int(np.random.default_rng(seed).choice(inner))
    here = np.array([segments[i]["dx"], segments[i]["dy"], segments[i]["dz"]])
    step = np.random.default_rng(seed).normal(0, 1, 3)
    cost, radii = node_value(segments, i, tuple(here + step), FLOW / DROP, law)
    tree = moved(as_tree(segments, len(segments), options), i, step)
    radius = tree_radii(tree)
    assert radii == pytest.approx(radius[[i, *tree.children[i]]], rel=1e-10)
    assert cost == pytest.approx(cost_of(tree, law), rel=1e-10)


def cost_of(tree, law):
    """K_root from radii and lengths."""
    radius = tree_radii(tree)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    total = (length**law.u) @ radius**law.lam
    return total / (FLOW / tree.terminals[0] / DROP) ** (0.25 * law.lam)


@settings(deadline=None, max_examples=examples(40))
@given(laws, st.integers(0, 10_000), st.integers(4, 25))
def test_a_graft_has_the_cost_of_the_tree_built_anew_and_can_be_undone(options, seed, terminals):
    law = options.law
    segments = spread_segments(seed, terminals, law)
    before = segments.copy()
    rng = np.random.default_rng(seed)
    deep = np.flatnonzero(segments["parent"] > 0)
    c = int(rng.choice(deep))
    p = int(segments[c]["parent"])
    saved = segments[:4].copy()
    free = cut_branch(segments, c, saved, law)
    targets = [
        i for i in range(1, len(segments)) if i not in (p, free) and not is_below(segments, i, c)
    ]
    if targets:
        i = int(rng.choice(targets))
        b = tuple(rng.normal(0, 3, 3))
        cost, fork = fork_cost(segments, i, c, b, FLOW / DROP, law)
        was = segments[i].copy()
        attach(segments, fork, c, free, law)
        tree = as_tree(segments, len(segments), options)
        assert len(set(tree.children[tree.children >= 0])) == len(segments) - 1
        radius = tree_radii(tree)
        assert [fork.up, fork.low, fork.new] == pytest.approx(radius[[i, free, c]], rel=1e-9)
        assert cost == pytest.approx(cost_of(tree, law), rel=1e-9)
        detach(segments, i, free, was, law)
        segments[c] = saved[2]
    undo_cut(segments, p, free, c, saved, law)
    for name in before.dtype.names:
        np.testing.assert_array_equal(segments[name], before[name], err_msg=name)


def test_best_node_is_where_a_search_over_the_volume_ends():
    """Three terminals: one branch point is free, and a general optimiser finds its place."""
    law = Law(0.01, 3.0, 2.0, 1.0)
    options = GrowthOptions(viscosity_pa_s=0.01 * np.pi / 8)
    for seed in range(3):
        segments = spread_segments(seed, 3, law)
        i = int(np.flatnonzero((segments["left"] >= 0) & (segments["parent"] == 0))[0])
        tree = as_tree(segments, len(segments), options)

        def volume(b, tree=tree, i=i):
            return tree_volume(moved(tree, i, b - tree.distal[i]))

        starts = [tree.distal[i], tree.distal.mean(axis=0), tree.proximal[i]]
        least = min(
            minimize(volume, x + 1e-3, method="Nelder-Mead", options={"maxiter": 4000}).fun
            for x in starts
        )
        for _ in range(200):
            b = best_node(segments, i, law)
            place(segments, i, (segments[i]["px"], segments[i]["py"], segments[i]["pz"]), b)
            for n in (segments[i]["left"], segments[i]["right"]):
                place(segments, n, b, (segments[n]["dx"], segments[n]["dy"], segments[n]["dz"]))
                refresh(segments, n, law)
            refresh_upwards(segments, i, law)
            spread_down(segments, len(segments), 1.0, 1.0, law)
        end = np.array([segments[i]["dx"], segments[i]["dy"], segments[i]["dz"]])
        assert volume(end) <= least * (1 + 1e-3)
