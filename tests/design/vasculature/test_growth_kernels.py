"""Kernels of growth: cost and its derivatives, pruning, collisions, against slow oracles."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.errors import NetworkError
from design.network import VesselNetwork
from design.vasculature import (
    GrowthOptions,
    check_network,
    collisions,
    tree_from_topology,
    tree_radii,
)
from design.vasculature.growth.kernels.bifurcation import (
    NewTerminal,
    best_place,
    climb,
    split_value,
)
from design.vasculature.growth.kernels.cost import SEGMENT, place, refresh, spread_down
from design.vasculature.growth.kernels.proposals import trial
from design.vasculature.growth.kernels.prune import prune
from design.vasculature.growth.territories import Surroundings
from design.vasculature.growth.tree import TreeGrowth
from design.vasculature.options import Law
from tests.design.networks import network, polyline, polylines
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
    segments["flow"] = segments["relative_viscosity"] = 1.0
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
def test_load_cost_sum_flows_and_radii_are_those_of_karch_and_murray(
    options, seed, terminals, uneven
):
    segments, count = random_segments(seed, terminals, options.law, uneven)
    tree = as_tree(segments, count, options)
    own, n, ratio = oracles.reduced_resistance(tree, 0, options.law.k)
    # The tree counts flows over the mean terminal's, the segments in the unit they were given.
    unit = float(segments[0]["flow"]) / n[0]
    resistance = unit * n[0] * own
    assert segments[0]["weighted_resistance"] == pytest.approx(resistance, rel=1e-12)
    for i, beta in ratio.items():
        assert tree.ratio[i] == pytest.approx(beta, rel=1e-12)
    radius = tree_radii(tree)
    relative = radius / radius[0]
    cost = (segments[:count]["length"] ** options.length_exponent) @ (
        relative**options.radius_exponent
    )
    expected = resistance ** (options.radius_exponent / 4) * cost
    assert segments[0]["cost_sum"] == pytest.approx(expected, rel=1e-11)
    flows = oracles.terminal_flows(tree, radius)
    asked = segments[:count]["flow"][tree.children[:, 0] < 0]
    np.testing.assert_allclose(flows, 10.0 * asked / asked.sum(), rtol=1e-10)
    inner = tree.children[:, 0] >= 0
    both = (radius[tree.children[inner]] ** options.murray_exponent).sum(axis=1)
    np.testing.assert_allclose(both, radius[inner] ** options.murray_exponent, rtol=1e-12)


ONE = NewTerminal(1.0, 1.0)


@settings(deadline=None, max_examples=examples(30))
@given(laws, st.integers(0, 10_000), st.integers(2, 25), st.booleans())
def test_climb_agrees_with_a_tree_built_anew(options, seed, terminals, uneven):
    """Radii and cost of a trial fork are those of the tree that has it."""
    law = options.law
    segments, count = random_segments(seed, terminals, law, uneven)
    new_terminal = NewTerminal(1.7, 1.0) if uneven else ONE
    rng = np.random.default_rng(seed)
    i = int(rng.integers(1, count))
    b, t = rng.normal(0, 3, 3), rng.normal(0, 3, 3)
    spread_down(segments, count, 1.0, 1.0, law)
    before = float(segments[0]["cost_sum"])
    fork, rise = trial(segments, i, b, t, new_terminal, law)
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
    segments[lower]["flow"], segments[tip]["flow"] = s["flow"], new_terminal.flow
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
    resistance = tree.reduced_resistance[0] * total
    expected = resistance ** (law.lam / 4) * (length**law.u @ relative**law.lam)
    assert before + rise == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("gamma", [2.5, 3.0])
def test_derivatives_at_the_root_agree_with_differences(gamma):
    law = Law(0.01, gamma, 2.0, 1.0)
    segments, count = random_segments(5, 20, law)
    spread_down(segments, count, 1.0, 1.0, law)
    for i in range(1, count, 3):
        resistance, cost_sum = (
            float(segments[i]["weighted_resistance"]),
            float(segments[i]["cost_sum"]),
        )
        _, by_resistance, by_cost_sum, _ = climb(segments, i, resistance, cost_sum, 1.0, 10**6, law)
        h = 1e-6
        whole = 10**6
        up = climb(segments, i, resistance * (1 + h), cost_sum, 1.0, whole, law)[0]
        down = climb(segments, i, resistance * (1 - h), cost_sum, 1.0, whole, law)[0]
        assert by_resistance == pytest.approx(
            (up - down) / (2 * h * resistance), rel=1e-5, abs=1e-8
        )
        up = climb(segments, i, resistance, cost_sum * (1 + h), 1.0, whole, law)[0]
        down = climb(segments, i, resistance, cost_sum * (1 - h), 1.0, whole, law)[0]
        assert by_cost_sum == pytest.approx((up - down) / (2 * h * cost_sum), rel=1e-5)


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
        _, by_resistance, by_cost_sum, _ = climb(
            segments, i, s["weighted_resistance"], s["cost_sum"], 1.0, 64, law
        )

        def value(b, s=s, p=p, d=d, t=t, by_resistance=by_resistance, by_cost_sum=by_cost_sum):
            lengths = [max(1e-6, np.linalg.norm(b - x)) for x in (p, d, t)]
            split = split_value(s, *lengths, ONE, law)
            return by_resistance * split[0] + by_cost_sum * split[1]

        found = value(np.array(best_place(s, *t, by_resistance, by_cost_sum, 200, ONE, law)))
        u, v = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
        grid = [p + a * (d - p) + b * (t - p) for a, b in zip(u.ravel(), v.ravel(), strict=True)]
        best = min(value(b) for b in grid)
        assert found <= best * (1 + 2e-3)


# Pruning of trees with too-wide vessels.


TERMINALS = 3000


def whole(segments):
    """Whether parents, children, ends and numbers of terminals agree."""
    inner = np.flatnonzero(segments["left"] >= 0)
    for side in ("left", "right"):
        child = segments[side][inner]
        assert (segments["parent"][child] == inner).all()
        for axis in "xyz":
            assert (segments[f"p{axis}"][child] == segments[f"d{axis}"][inner]).all()
    below = sum(segments["terminals"][segments[side][inner]] for side in ("left", "right"))
    assert (segments["terminals"][inner] == below).all()
    assert (segments["terminals"][segments["left"] < 0] == 1).all()
    return len(segments) == 2 * segments["terminals"][0] - 1


@pytest.fixture
def growth(box):
    options = GrowthOptions(terminals=TERMINALS, root_at_top=True)
    growth = TreeGrowth.open(box, options, Surroundings(), 1.7, 0)
    growth.start()
    growth.grow()
    growth.audit()
    return growth


def pruned(growth, smallest):
    args = growth.segments, growth.count, growth.index, growth.clearances, growth.options.law
    growth.progress["count"] = prune(*args, smallest)
    return growth.segments[: growth.count]


@pytest.mark.parametrize("smallest", [0.0, np.inf], ids=["tips may move", "tips stay"])
def test_a_vessel_that_is_too_wide_loses_what_makes_it_thin_enough(growth, smallest):
    s = growth.segments[: growth.count]
    wide = int(np.argmin(np.abs(s["terminals"] - 800)))
    fed = int(s["terminals"][wide])
    s["allowed"] = np.inf
    s["allowed"][wide] = 0.97 * s["radius"][wide]
    left = pruned(growth, smallest)
    assert whole(left)
    lost = TERMINALS - left["terminals"][0]
    thin_enough = 1.0 - (0.98 * 0.97) ** growth.options.law.gamma
    assert thin_enough * fed - 2 <= lost <= thin_enough * fed + 2


def test_terminals_in_the_way_cost_few_others(growth):
    # A vessel is seldom straight enough to do without its branch: those that aren't must not take
    # the branches above with them, up to the root.
    s = growth.segments[: growth.count]
    s["allowed"] = np.inf
    tips = np.flatnonzero(s["left"] < 0)[::10]
    s["allowed"][tips] = 0.9 * s["radius"][tips]
    left = pruned(growth, 0.0)
    assert whole(left)
    assert TERMINALS - left["terminals"][0] <= 1.05 * len(tips)


# Collisions, against all pairs.


def straight(*ends, radius=0.5):
    """Vessels between points given as pairs; equal points are one node."""
    points = [tuple(p) for pair in ends for p in pair]
    nodes = list(dict.fromkeys(points))
    return network(nodes, np.reshape([nodes.index(p) for p in points], (-1, 2)), radius)


def test_vessels_that_cross_come_too_near_or_have_no_length_are_refused():
    crossed = straight(((0, 0, 0), (10, 0, 0)), ((5, -5, 0.4), (5, 5, 0.4)))
    with pytest.raises(NetworkError, match=r"vessels 0 and 1 .* 0\.6 mm at \(5, 0, 0\.2\)"):
        check_network(crossed)
    beside = straight(((0, 0, 0), (10, 0, 0)), ((0, 2, 0), (10, 2, 0)))
    check_network(beside, clearance_mm=0.99)
    with pytest.raises(NetworkError, match="are only 1 mm apart"):
        check_network(beside, clearance_mm=1.01)
    points = np.array([[0, 0, 0], [9, 0, 0], [9, 3, 0], [5, 3, 0], [5, 0.8, 0]], dtype=float)
    with pytest.raises(NetworkError, match="vessels 0 and 0 overlap"):
        check_network(polyline(points, 0.5))
    with pytest.raises(NetworkError, match="vessel 0 has no length"):
        check_network(network(np.zeros((2, 3)), [(0, 1)], 0.5))


def forked(*ways: object) -> VesselNetwork:
    """Vessels of radius 0.35 mm along x to (5, 0, 0), and from there."""
    return polylines(
        [np.array([[0, 0, 0], [5, 0, 0]]), *(np.vstack([[5, 0, 0], way]) for way in ways)], 0.35
    )


def test_daughters_that_leave_side_by_side_are_one_lumen_until_they_part():
    share = np.linspace(0, 1, 14)[1:]
    smooth = [
        np.column_stack([5 + 9 * share, side * (3 * share**2 - 2 * share**3), 0 * share])
        for side in (2.5, -2.5)
    ]
    assert collisions(forked(*smooth)).count
    check_network(forked(*smooth))
    # Two that part and cross again, be they given by many points or by few, are no joint.
    again = np.vstack([smooth[0], [[15, -6, 0]]])
    with pytest.raises(NetworkError, match=r"vessels 1 and 2 overlap .* \(1 such pairs"):
        check_network(forked(again, smooth[1]))
    with pytest.raises(NetworkError, match="vessels 1 and 2 overlap"):
        check_network(forked([[14, 0, 0]], [[7, 4, 0], [11, -2, 0]]))


@settings(deadline=None, max_examples=examples(60))
@given(
    st.integers(0, 10_000),
    st.integers(2, 40),
    st.sampled_from([(0.0, 0.0), (0.3, 0.0), (0.0, 0.5)]),
)
def test_collisions_agree_with_all_pairs(seed, count, clearance):
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(0, 10, (count, 3))
    ends = {(int(rng.integers(0, n)), n) for n in range(1, count)}
    tree = network(nodes, sorted(ends), rng.uniform(0.05, 0.8, len(ends)))
    found = collisions(tree, *clearance)
    colliding, joints = oracles.colliding_pairs(tree, *clearance)
    assert set(map(tuple, found.pieces.tolist())) == colliding
    assert set(map(tuple, found.joint_pieces.tolist())) == joints


def test_a_hairpin_with_a_long_way_around_collides():
    hairpin = [(0, 0, 0), (9, 0, 0), (9, 3, 0), (5, 3, 0), (5, 0.8, 0)]
    found = collisions(straight(*itertools.pairwise(hairpin)))
    assert found.vessels.tolist() == [[0, 3]]
