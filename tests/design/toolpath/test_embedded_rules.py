"""Joints and precedence rules, against slow oracles that sample tip and ink densely."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.needle import joint_reach, radius_at
from design.toolpath.embedded.rules import find_rules, one_way, outside_joints, with_more
from tests.design.toolpath.embedded_parts import Parts, pairs_of, parts_of, rules_of
from tests.design.toolpath.shapes import (
    cage,
    network,
    polyline,
    polylines,
    random_tree,
    ring,
)
from tests.slower import examples

OPTIONS = EmbeddedOptions()
CONE = replace(OPTIONS, needle_outer_mm=0.8, tip_outer_mm=0.31, cone_mm=1.5)
CROSSED = network([(-2, 0, 0), (2, 0, 0), (0, -2, 0.1), (0, 2, 0.1)], [(0, 1), (2, 3)], 0.15)
TILTED_RING = polylines([ring(0.9, 1.2)], 0.15)
FORKS = network(
    [(0, 0, 0), (1.5, 0, 1.2), (2, 1, 0.3), (0.4, 0.3, 1.5)], [(0, 1), (0, 2), (3, 0)], 0.15
)


def meetings_of(net, parts: Parts):
    """(vessel, way along it, other vessel, way along that, gap) of each node and touch."""
    length = net.lengths()
    ends = [(v, k, n) for v, both in enumerate(net.vessel_nodes) for k, n in enumerate(both)]
    rows = [
        (
            v,
            j * parts.elements.length[parts.elements.vessel == v].sum(),
            w,
            k * parts.elements.length[parts.elements.vessel == w].sum(),
            0.0,
        )
        for v, j, n in ends
        for w, k, m in ends
        if n == m and (v, j) != (w, k)
    ]
    assert len(length) == net.vessel_count
    touches = parts.touches
    for (v, w), (a, b), gap in zip(touches.vessel, touches.arc, touches.gap, strict=True):
        rows += [(v, a, w, b, gap), (w, b, v, a, gap)]
    return rows


def spared(vessel, at, other, places, reach, meetings):
    """Which places (n,) along another vessel belong to a joint of the tip, at a place or (k, 1)."""
    found = (other == vessel) & (np.abs(places - at) <= reach)
    for v, own, w, there, gap in meetings:
        if v == vessel and w == other:
            found |= (np.abs(own - at) + gap <= reach) & (np.abs(places - there) <= reach)
    return found


def shaft_gap(places, needle):
    """Distance of places (k, 3), from the tip, to a shaft made of discs, the tip's the lowest."""
    across, up = np.hypot(*places[:, :2].T), places[:, 2]
    found = np.hypot(np.maximum(across - needle.shaft_mm, 0), np.minimum(up - needle.cone_mm, 0))
    height, radius = discs_of(needle)
    discs = np.hypot(np.maximum(across - radius, 0), up - height)
    return np.minimum(found, discs.min(axis=0, initial=np.inf))


@cache
def discs_of(needle):
    """Heights and radii (k, 1) of the discs of a cone, mm; none of a needle without."""
    height = np.linspace(0, needle.cone_mm, 60 if needle.cone_mm else 0)
    radius = np.array([radius_at(needle, one) for one in height])
    return height[:, None], radius[:, None]


def naive_rules(net, parts: Parts, slack: float):
    """Pairs of elements by all places of the tip and all places of the ink."""
    elements, needle = parts.elements, parts.needle
    meetings = defaultdict(list)
    for row in meetings_of(net, parts):
        meetings[row[0], row[2]].append(row)
    share = np.linspace(0, 1, 21)[:, None]
    ink = [
        elements.point[a] + share * (elements.point[b] - elements.point[a]) for a, b in elements.end
    ]
    along = elements.arc[:, None] + share.T * elements.length[:, None]
    thick = elements.radius.max(axis=1)
    middle = elements.point[elements.end].mean(axis=1)
    found = set()
    for i, vessel in enumerate(elements.vessel.tolist()):
        far = np.hypot(*(middle - middle[i])[:, :2].T)
        for j in np.flatnonzero(far < needle.shaft_mm + 2 * thick.max() + 0.4).tolist():
            reach = joint_reach(needle, max(thick[i], thick[j])) - slack
            other = int(elements.vessel[j])
            at, near = along[i][::2, None], meetings[vessel, other]
            left = ~spared(vessel, at, other, along[j], reach, near)
            from_tips = (ink[j] - ink[i][::2, None])[left]
            if i != j and len(from_tips) and shaft_gap(from_tips, needle).min() < thick[j] + slack:
                found.add((i, j))
    return found


@pytest.mark.parametrize(
    ("net", "options"),
    [
        (random_tree(4, 3, 1, 0.1), OPTIONS),
        (random_tree(4, 3, 2, 0.1), replace(OPTIONS, overlap_radii=1.5)),
        (random_tree(2, 3, 5, 0.1), CONE),
        (FORKS, OPTIONS),
        (CROSSED, OPTIONS),
        (TILTED_RING, OPTIONS),
        pytest.param(cage(3, 0.8, 1.0), OPTIONS, marks=pytest.mark.slow),
    ],
)
def test_rules_are_those_of_all_tips_and_all_ink(net, options):
    parts = parts_of(net, options)
    rules = find_rules(parts.elements, parts.squares, parts.meetings, parts.needle)
    found = set(pairs_of(rules))
    assert found or net is CROSSED  # all of which is one joint
    assert naive_rules(net, parts, -0.01) <= found <= naive_rules(net, parts, 0.01)


@pytest.mark.parametrize(
    ("nodes", "harm"),
    [
        ([(-1, 0, 0), (1, 0, 0), (0, -1, 2), (0, 1, 2)], 0.3),  # all of the upper one's height
        # side by side: the shaft's 0.155 mm and the filament's 0.15 pass each other
        ([(-1, 0, 0), (1, 0, 0), (-1, 0.33, 2), (1, 0.33, 2)], 0.003),
    ],
)
def test_a_rule_says_what_harm_the_shaft_would_do(nodes, harm):
    parts = parts_of(network(nodes, [(0, 1), (2, 3)], 0.15), OPTIONS)
    pairs = pairs_of(find_rules(parts.elements, parts.squares, parts.meetings, parts.needle))
    vessel = parts.elements.vessel
    assert {(int(vessel[i]), int(vessel[j])) for i, j in pairs} == {(0, 1)}
    assert max(pairs.values()) == pytest.approx(harm)


def test_a_fold_of_a_vessel_harms_itself_beyond_the_reach_of_a_joint():
    fold = np.array([[0.0, 0, 0], [3, 0, 0], [3, 0.33, 0], [0, 0.33, 0]])
    parts = parts_of(polyline(fold, 0.15), OPTIONS)
    pairs = pairs_of(find_rules(parts.elements, parts.squares, parts.meetings, parts.needle))
    reach = joint_reach(parts.needle, 0.15)
    arc = parts.elements.arc + parts.elements.length / 2
    apart = np.array([abs(arc[i] - arc[j]) for i, j in pairs])
    assert apart.min() > reach - 0.1
    assert apart.max() > 5


@settings(max_examples=examples(60), deadline=None)
@given(
    at=st.floats(0, 2.2), reach=st.floats(0.3, 1.2), j=st.integers(0, 60), vessel=st.integers(0, 2)
)
def test_what_lies_outside_joints_is_what_no_place_near_both_holds(at, reach, j, vessel):
    parts = parts_of(FORKS, OPTIONS)
    elements = parts.elements
    j = j % len(elements.end)
    at = min(at, float(elements.length[elements.vessel == vessel].sum()))
    low, high = outside_joints(vessel, at, j, reach, elements, parts.meetings)
    share = np.linspace(0.01, 0.99, 50)
    places = elements.arc[j] + share * elements.length[j]
    joint = spared(vessel, at, elements.vessel[j], places, reach, meetings_of(FORKS, parts))
    sure = np.minimum(np.abs(share - low), np.abs(share - high)) > 1e-6
    assert np.array_equal(((share > low) & (share < high))[sure], ~joint[sure])


def test_vessels_that_overlap_are_one_body_where_they_do():
    parts = parts_of(CROSSED, OPTIONS)
    assert set(map(tuple, parts.touches.vessel.tolist())) == {(0, 1)}
    assert parts.touches.arc == pytest.approx(2.0, abs=0.3)
    assert parts.touches.overlap.max() == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("net", [random_tree(6, 8, 0, 0.1), cage(4, 2, 3), TILTED_RING])
def test_vessels_that_meet_at_nodes_alone_touch_nowhere_else(net):
    assert len(parts_of(net, OPTIONS).touches.overlap) == 0


def random_rules(seed, count, density, ranked):
    rng = np.random.default_rng(seed)
    rank = rng.permutation(count)
    pairs = {
        (a, b): float(rng.integers(1, 4))
        for a in range(count)
        for b in range(count)
        if a != b and (not ranked or rank[a] < rank[b]) and rng.random() < density
    }
    return rules_of(pairs, count), pairs


@settings(max_examples=examples(30), deadline=None)
@given(seed=st.integers(0, 999), count=st.integers(1, 12), density=st.floats(0, 1))
def test_of_two_opposite_rules_the_deeper_stays(seed, count, density):
    rules, pairs = random_rules(seed, count, density, ranked=False)
    expected = {
        (a, b): depth
        for (a, b), depth in pairs.items()
        if (depth, -a) > (pairs.get((b, a), -1.0), -b)
    }
    assert pairs_of(one_way(rules, np.arange(count))) == expected


def test_of_two_vessels_that_bar_each_other_one_goes_first_altogether():
    """By themselves (0, 2) and (3, 1) would stay: the two would be written in turns."""
    pairs = {(0, 2): 3.0, (2, 0): 1.0, (1, 3): 1.0, (3, 1): 2.0, (3, 0): 9.0}
    kept = one_way(rules_of(pairs, 4), np.array([0, 0, 1, 1]))
    assert pairs_of(kept) == {(0, 2): 3.0, (1, 3): 1.0, (3, 0): 9.0}


def test_of_two_elements_of_one_vessel_each_pair_decides_for_itself():
    pairs = {(0, 2): 3.0, (2, 0): 1.0, (1, 3): 1.0, (3, 1): 2.0}
    kept = one_way(rules_of(pairs, 4), np.zeros(4, dtype=np.int64))
    assert pairs_of(kept) == {(0, 2): 3.0, (3, 1): 2.0}


@settings(max_examples=examples(30), deadline=None)
@given(seed=st.integers(0, 999), count=st.integers(2, 12), density=st.floats(0, 1))
def test_more_rules_are_added_once(seed, count, density):
    rules, pairs = random_rules(seed, count, density, ranked=False)
    rng = np.random.default_rng(seed)
    first, after = rng.integers(0, count, (2, 9))
    expected = dict(pairs)
    for pair in zip(first.tolist(), after.tolist(), strict=True):
        if pair[::-1] not in expected:
            expected.setdefault(pair, 0.0)
    assert pairs_of(with_more(rules, first, after)) == expected
