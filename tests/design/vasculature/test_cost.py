"""Cost of growth and its derivatives, against Karch's recursion and differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.vasculature import GrowthOptions, tree_from_topology, tree_radii
from design.vasculature.growth.fit import best_place, split_value
from design.vasculature.growth.propose import trial
from design.vasculature.growth.state import SEGMENT, Sprout, climb, place, refresh, spread_down
from design.vasculature.options import Law
from tests.design.vasculature import oracles
from tests.slower import examples

laws = st.builds(
    GrowthOptions,
    murray_exponent=st.sampled_from([2.0, 2.7, 3.0, 3.5]),
    radius_exponent=st.sampled_from([1.0, 2.0, 3.0]),
    length_exponent=st.sampled_from([1.0, 1.5]),
)


def as_tree(segments, count, options):
    s = segments[:count]
    return tree_from_topology(
        np.column_stack([s["px"], s["py"], s["pz"]]),
        np.column_stack([s["dx"], s["dy"], s["dz"]]),
        s["parent"],
        np.column_stack([s["left"], s["right"]]),
        flow_ul_s=10.0,
        pressure_drop_pa=5000.0,
        murray_exponent=options.murray_exponent,
        viscosity_pa_s=options.viscosity_pa_s,
        relative_flow=s["flow"],
    )


def random_segments(seed, terminals, law, uneven=False):
    """A random binary tree as growing segments; lengths of some millimetres."""
    rng = np.random.default_rng(seed)
    segments = np.zeros(2 * terminals + 1, SEGMENT)
    segments["flow"] = segments["thick"] = 1.0
    parent, children = [-1], [[-1, -1]]
    ends = [(np.zeros(3), rng.normal(0, 3, 3))]
    while len(parent) < 2 * terminals - 1:
        leaves = [i for i, c in enumerate(children) if c[0] < 0]
        i = int(rng.choice(leaves))
        for side in range(2):
            children[i][side] = len(parent)
            parent.append(i)
            children.append([-1, -1])
            ends.append((ends[i][1], ends[i][1] + rng.normal(0, 3, 3)))
    for i in range(len(parent)):
        place(segments, i, tuple(ends[i][0]), tuple(ends[i][1]))
        segments[i]["parent"] = parent[i]
        segments[i]["left"], segments[i]["right"] = children[i]
    if uneven:
        segments["flow"] = rng.uniform(0.1, 3.0, len(segments))
    for i in range(len(parent) - 1, -1, -1):
        refresh(segments, i, law)
    return segments, len(parent)


@settings(deadline=None, max_examples=examples(40))
@given(laws, st.integers(0, 10_000), st.integers(1, 25), st.booleans())
def test_load_spend_flows_and_radii_are_those_of_karch_and_murray(options, seed, terminals, uneven):
    segments, count = random_segments(seed, terminals, options.law, uneven)
    tree = as_tree(segments, count, options)
    own, n, ratio = oracles.reduced_resistance(tree, 0, options.law.k)
    # The tree counts flows over the mean terminal's, the segments in the unit they were given.
    unit = float(segments[0]["flow"]) / n[0]
    load = unit * n[0] * own
    assert segments[0]["load"] == pytest.approx(load, rel=1e-12)
    for i, beta in ratio.items():
        assert tree.ratio[i] == pytest.approx(beta, rel=1e-12)
    radius = tree_radii(tree)
    relative = radius / radius[0]
    cost = (segments[:count]["length"] ** options.length_exponent) @ (
        relative**options.radius_exponent
    )
    expected = load ** (options.radius_exponent / 4) * cost
    assert segments[0]["spend"] == pytest.approx(expected, rel=1e-11)
    flows = oracles.terminal_flows(tree, radius)
    asked = segments[:count]["flow"][tree.children[:, 0] < 0]
    np.testing.assert_allclose(flows, 10.0 * asked / asked.sum(), rtol=1e-10)
    inner = tree.children[:, 0] >= 0
    both = (radius[tree.children[inner]] ** options.murray_exponent).sum(axis=1)
    np.testing.assert_allclose(both, radius[inner] ** options.murray_exponent, rtol=1e-12)


ONE = Sprout(1.0, 1.0)


@settings(deadline=None, max_examples=examples(30))
@given(laws, st.integers(0, 10_000), st.integers(2, 25), st.booleans())
def test_climb_agrees_with_a_tree_built_anew(options, seed, terminals, uneven):
    """Radii and cost of a trial fork are those of the tree that has it."""
    law = options.law
    segments, count = random_segments(seed, terminals, law, uneven)
    sprout = Sprout(1.7, 1.0) if uneven else ONE
    rng = np.random.default_rng(seed)
    i = int(rng.integers(1, count))
    b, t = rng.normal(0, 3, 3), rng.normal(0, 3, 3)
    spread_down(segments, count, 1.0, 1.0, law)
    before = float(segments[0]["spend"])
    fork, rise = trial(segments, i, b, t, sprout, law)
    s = segments[i]
    end, children = (s["dx"], s["dy"], s["dz"]), (s["left"], s["right"])
    lower, tip = count, count + 1
    place(segments, lower, tuple(b), end)
    place(segments, tip, tuple(b), tuple(t))
    place(segments, i, (s["px"], s["py"], s["pz"]), tuple(b))
    segments[lower]["left"], segments[lower]["right"] = children
    segments[tip]["left"] = segments[tip]["right"] = -1
    segments[lower]["parent"] = segments[tip]["parent"] = i
    for child in children:
        if child >= 0:
            segments[child]["parent"] = lower
    segments[lower]["flow"], segments[tip]["flow"] = s["flow"], sprout.flow
    segments[i]["left"], segments[i]["right"] = lower, tip
    tips = segments[: count + 2]["left"] < 0
    total = float(segments["flow"][: count + 2][tips].sum())
    tree = as_tree(segments, count + 2, options)
    radius = tree_radii(tree)
    relative = radius / radius[0]
    assert fork.up == pytest.approx(relative[i], rel=1e-10)
    assert fork.low == pytest.approx(relative[lower], rel=1e-10)
    assert fork.new == pytest.approx(relative[tip], rel=1e-10)
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    load = tree.reduced_resistance[0] * total
    expected = load ** (law.lam / 4) * (length**law.u @ relative**law.lam)
    assert before + rise == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("gamma", [2.5, 3.0])
def test_derivatives_at_the_root_agree_with_differences(gamma):
    law = Law(0.01, gamma, 2.0, 1.0)
    segments, count = random_segments(5, 20, law)
    spread_down(segments, count, 1.0, 1.0, law)
    for i in range(1, count, 3):
        load, spend = float(segments[i]["load"]), float(segments[i]["spend"])
        _, by_load, by_spend, _ = climb(segments, i, load, spend, 1.0, 10**6, law)
        h = 1e-6
        whole = 10**6
        up = climb(segments, i, load * (1 + h), spend, 1.0, whole, law)[0]
        down = climb(segments, i, load * (1 - h), spend, 1.0, whole, law)[0]
        assert by_load == pytest.approx((up - down) / (2 * h * load), rel=1e-5, abs=1e-8)
        up = climb(segments, i, load, spend * (1 + h), 1.0, whole, law)[0]
        down = climb(segments, i, load, spend * (1 - h), 1.0, whole, law)[0]
        assert by_spend == pytest.approx((up - down) / (2 * h * spend), rel=1e-5)


def test_derivatives_of_a_split_agree_with_differences():
    law = Law(0.01, 3.0, 2.0, 1.0)
    segments, _ = random_segments(6, 12, law)
    lengths = np.array([1.3, 0.7, 2.1])
    value = split_value(segments[1], *lengths, ONE, law)
    h = 1e-6
    for axis in range(3):
        step = h * np.eye(3)[axis]
        up, down = (split_value(segments[1], *(lengths + s), ONE, law) for s in (step, -step))
        assert value[2 + axis] == pytest.approx((up[0] - down[0]) / (2 * h), rel=1e-6)
        assert value[5 + axis] == pytest.approx((up[1] - down[1]) / (2 * h), rel=1e-6)


def test_best_place_beats_a_fine_search_by_nobody():
    """Weiszfeld's place is no dearer than the best of a fine grid in the plane of the three."""
    law = Law(0.01, 3.0, 2.0, 1.0)
    segments, count = random_segments(7, 10, law)
    rng = np.random.default_rng(7)
    for i in range(1, count, 2):
        s = segments[i]
        p, d = np.array([s["px"], s["py"], s["pz"]]), np.array([s["dx"], s["dy"], s["dz"]])
        t = 0.5 * (p + d) + rng.normal(0, 2, 3)
        spread_down(segments, count, 1.0, 1.0, law)
        _, by_load, by_spend, _ = climb(segments, i, s["load"], s["spend"], 1.0, 64, law)

        def value(b, s=s, p=p, d=d, t=t, by_load=by_load, by_spend=by_spend):
            lengths = [max(1e-6, np.linalg.norm(b - x)) for x in (p, d, t)]
            split = split_value(s, *lengths, ONE, law)
            return by_load * split[0] + by_spend * split[1]

        found = value(np.array(best_place(s, *t, by_load, by_spend, 200, ONE, law)))
        u, v = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
        grid = [p + a * (d - p) + b * (t - p) for a, b in zip(u.ravel(), v.ravel(), strict=True)]
        best = min(value(b) for b in grid)
        assert found <= best * (1 + 2e-3)
