"""Steps of the embedded planner, one by one, against slow oracles that sample tip and ink."""

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.elements import CUTTING, elements_of, squares_of
from design.toolpath.embedded.needle import (
    Needle,
    joint_reach,
    radius_at,
)
from design.toolpath.embedded.order.pass_order import TRAVEL, broken_rules, fewest, shorten_travels
from design.toolpath.embedded.order.schedule import Leg, Pass, schedule_passes
from design.toolpath.embedded.rules import Rules, along_elements, find_meetings, find_rules
from design.toolpath.embedded.touches import touches
from tests.design.networks import network, polyline, polylines
from tests.design.toolpath.shapes import cage, helix, random_tree, ring
from tests.slower import examples

OPTIONS = EmbeddedOptions(overlap_radii=0.5)
FORKS = network(
    [(0, 0, 0), (1.5, 0, 1.2), (2, 1, 0.3), (0.4, 0.3, 1.5)], [(0, 1), (0, 2), (3, 0)], 0.15
)
CROSSED = network([(-2, 0, 0), (2, 0, 0), (0, -2, 0.1), (0, 2, 0.1)], [(0, 1), (2, 3)], 0.15)
TILTED_RING = polylines([ring(0.9, 1.2)], 0.15)
TREE = elements_of(random_tree(4, 8, 0, 0.1), 0.8)


def parts_of(net, options=OPTIONS):
    """What the planner finds before its rules: elements, squares, touches, meetings, needle."""
    bare = options.tip_mm - options.clearance_mm
    shaft = options.tip_mm, options.shaft_mm, options.cone_mm, options.overlap_radii
    needle = Needle(bare, bare, *shaft)
    elements, found = elements_of(net, 0.1), touches(net, needle)
    length = np.add.reduceat(elements.length, elements.first[:-1])
    return SimpleNamespace(
        elements=elements,
        squares=squares_of(elements, needle.shaft_mm),
        touches=found,
        meetings=find_meetings(net.vessel_nodes, length, along_elements(found, elements)),
        needle=needle,
    )


def rules_of(pairs, count):
    """Rules from (first, after) and their depth."""
    first, after = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2).T
    begin = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=count))])
    depth = np.array([pairs[pair] for pair in sorted(pairs)], dtype=np.float64)
    return Rules(begin.astype(np.int64), after.copy(), depth)


def pairs_of(rules):
    """(first, after) of every rule."""
    first = np.repeat(np.arange(len(rules.begin) - 1), np.diff(rules.begin))
    return set(zip(first.tolist(), rules.after.tolist(), strict=True))


def gap_to_line(place, line):
    a, way = line[:-1], np.diff(line, axis=0)
    share = np.clip(((place - a) * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    return np.linalg.norm(a + share[:, None] * way - place, axis=1).min()


@pytest.mark.parametrize(
    "net",
    [
        random_tree(9, 8, 1, 0.1),
        cage(5, 2.0, 3.0),
        polyline(helix(2, 2.0, 1.0), 0.2),
        polylines([ring(2.0, 0.3)], 0.2),
    ],
)
def test_vessels_lie_within_2_um_of_elements_that_lose_no_length(net):
    elements = elements_of(net, 0.15)
    assert elements.length.max() <= 0.15 * (1 + 1e-9)
    length = np.add.reduceat(elements.length, elements.first[:-1])
    assert length == pytest.approx(net.lengths(), rel=1e-3)  # chords of curves are shorter
    for vessel in range(net.vessel_count):
        own = elements.end[elements.first[vessel] : elements.first[vessel + 1]]
        line = elements.point[np.append(own[:, 0], own[-1, 1])]
        assert (
            max(gap_to_line(p, line) for p in net.polyline(vessel)[0])
            <= CUTTING.straight_mm + 1e-12
        )


def test_radii_are_those_along_a_tapered_vessel_in_steps_of_at_most_5_percent():
    net = polyline(np.array([[0.0, 0, 0], [4, 0, 3], [4, 0, 5]]), np.array([0.3, 0.1, 0.15]))
    elements = elements_of(net, 1.0)
    arc = np.column_stack([elements.arc, elements.arc + elements.length])
    expected = np.interp(arc, [0, 5, 7], [0.3, 0.1, 0.15])
    assert elements.radius == pytest.approx(expected, rel=1e-9)
    # Steps are equal in length, so the thin end's are somewhat more.
    assert np.abs(np.diff(np.log(elements.radius), axis=1)).max() < 2.2 * CUTTING.taper_step


def shaft_gap(places, needle):
    """Distance of places (k, 3), from the tip, to a shaft made of discs, the tip's the lowest."""
    across, up = np.hypot(*places[:, :2].T), places[:, 2]
    found = np.hypot(np.maximum(across - needle.shaft_mm, 0), np.minimum(up - needle.cone_mm, 0))
    height = np.linspace(0, needle.cone_mm, 60 if needle.cone_mm else 0)
    radius = np.array([radius_at(needle, one) for one in height])
    discs = np.hypot(np.maximum(across - radius[:, None], 0), up - height[:, None])
    return np.minimum(found, discs.min(axis=0, initial=np.inf))


def test_vessels_touch_where_they_overlap_and_nowhere_else():
    crossed = parts_of(CROSSED).touches
    assert set(map(tuple, crossed.vessel.tolist())) == {(0, 1)}
    assert crossed.arc == pytest.approx(2.0, abs=0.3)
    assert crossed.overlap.max() == pytest.approx(0.2, abs=0.02)
    for net in (random_tree(6, 8, 0, 0.1), cage(4, 2, 3), TILTED_RING):
        assert len(parts_of(net).touches.overlap) == 0


def meetings_of(net, parts):
    """Of two vessels, (way along one, way along other, gap) at each node and touch."""
    length = np.add.reduceat(parts.elements.length, parts.elements.first[:-1])
    ends = [(v, k, n) for v, both in enumerate(net.vessel_nodes) for k, n in enumerate(both)]
    found = defaultdict(list)
    for v, j, n in ends:
        for w, k, m in ends:
            if n == m and (v, j) != (w, k):
                found[v, w].append((j * length[v], k * length[w], 0.0))
    here = parts.touches
    for (v, w), (a, b), gap in zip(here.vessel, here.arc, here.gap, strict=True):
        found[v, w].append((a, b, gap))
        found[w, v].append((b, a, gap))
    return found


def naive_rules(net, parts, slack):
    """Pairs of elements by all places of the tip and all places of the ink outside joints."""
    elements, needle, meetings = parts.elements, parts.needle, meetings_of(net, parts)
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
            at, other = along[i][::2, None], int(elements.vessel[j])
            joint = (other == vessel) & (np.abs(along[j] - at) <= reach)
            for own, there, gap in meetings[vessel, other]:
                joint |= (np.abs(own - at) + gap <= reach) & (np.abs(along[j] - there) <= reach)
            from_tips = (ink[j] - ink[i][::2, None])[~joint]
            if i != j and len(from_tips) and shaft_gap(from_tips, needle).min() < thick[j] + slack:
                found.add((i, j))
    return found


@pytest.mark.parametrize(
    ("net", "options"),
    [
        (random_tree(4, 3, 1, 0.1), OPTIONS),
        (random_tree(4, 3, 2, 0.1), replace(OPTIONS, overlap_radii=1.5)),
        (
            random_tree(2, 3, 5, 0.1),
            replace(OPTIONS, needle_outer_mm=0.8, tip_outer_mm=0.31, cone_mm=1.5),
        ),
        (FORKS, OPTIONS),
        (CROSSED, OPTIONS),
        (TILTED_RING, OPTIONS),
        pytest.param(cage(3, 0.8, 1.0), OPTIONS, marks=pytest.mark.slow),
    ],
)
def test_rules_are_those_of_all_tips_and_all_ink(net, options):
    parts = parts_of(net, options)
    found = pairs_of(find_rules(parts.elements, parts.squares, parts.meetings, parts.needle))
    assert found or net is CROSSED  # all of which is one joint
    assert naive_rules(net, parts, -0.01) <= found <= naive_rules(net, parts, 0.01)


def broken(pairs, order):
    """Rules that an order of elements breaks."""
    when = {element: place for place, element in enumerate(order)}
    return {(i, j) for i, j in pairs if when[j] < when[i]}


def order_of(passes):
    return np.concatenate([one.elements() for one in passes]).tolist()


def check_joined(passes, elements):
    """No pass jumps: each element begins where the one before it ended."""
    for one in passes:
        ways = []
        for leg in one.legs:
            ends = elements.end[leg.elements()]
            ways += (ends if leg.step > 0 else ends[:, ::-1]).tolist()
        assert all(a[1] == b[0] for a, b in pairwise(ways))


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 999), density=st.floats(0, 0.4), ranked=st.booleans())
def test_all_is_written_once_and_rules_that_can_all_be_kept_are_kept(seed, density, ranked):
    rng, count = np.random.default_rng(seed), len(TREE.end)
    rank = rng.permutation(count)
    pairs = {
        (a, b): float(rng.integers(1, 4))
        for a in range(count)
        for b in range(count)
        if a != b and (not ranked or rank[a] < rank[b]) and rng.random() < density
    }
    rules = rules_of(pairs, count)
    passes = schedule_passes(TREE, rules, np.zeros(len(TREE.first) - 1, dtype=np.int64))
    order = order_of(passes)
    assert sorted(order) == list(range(count))
    first, after = broken_rules(rules, passes)
    assert set(zip(first.tolist(), after.tolist(), strict=True)) == broken(pairs, order)
    assert not (ranked and len(first))
    check_joined(passes, TREE)


def bars(places, long_mm=0.05):
    """Elements of bars along x that begin at the places (n, 3), and one head for all."""
    places = np.asarray(places, float)
    nodes = [tuple(p) for place in places for p in (place, place + [long_mm, 0, 0])]
    pairs = [(2 * k, 2 * k + 1) for k in range(len(places))]
    elements = elements_of(network(nodes, pairs, 0.2), 0.1)
    return elements, np.zeros(len(places), dtype=np.int64)


def vessel_passes(elements):
    return [Pass((Leg(a, 1, b - a),)) for a, b in pairwise(elements.first.tolist())]


@settings(max_examples=examples(60), deadline=None)
@given(seed=st.integers(0, 9999), vessels=st.integers(2, 9), density=st.floats(0, 0.5))
def test_merging_keeps_all_rules_and_writes_everything_once(seed, vessels, density):
    rng = np.random.default_rng(seed)
    nodes = [(float(k), 0.0, 0.0) for k in range(vessels + 1)]
    elements = elements_of(network(nodes, list(pairwise(range(vessels + 1))), 0.2), 0.1)
    each = vessel_passes(elements)
    passes = [each[k] for k in rng.permutation(vessels)]
    order = {e: n for n, e in enumerate(order_of(passes))}
    drawn = rng.integers(0, len(order), (int(density * len(order) ** 1.5), 2)).tolist()
    pairs = {tuple(sorted(pair, key=order.get)): 1.0 for pair in drawn if pair[0] != pair[1]}
    rules = rules_of(pairs, len(elements.end))
    found = fewest(passes, elements, rules, np.zeros(vessels, dtype=np.int64), rng)
    assert sorted(order_of(found)) == list(range(len(elements.end)))
    assert broken(pairs, order_of(found)) == set()
    assert len(found) <= len(passes)


def way_between(passes, elements):
    """Way of the travels from each pass of one leg to the next, a climb counting more."""
    lines = [elements.point[elements.end[one.elements()]] for one in passes]
    steps = [one.legs[0].step for one in passes]
    ends = [
        (e[0, 0], e[-1, 1]) if s > 0 else (e[0, 1], e[-1, 0])
        for e, s in zip(lines, steps, strict=True)
    ]
    return sum(
        np.hypot(*(a - b)[:2]) + TRAVEL.climb * abs((a - b)[2]) for (_, a), (b, _) in pairwise(ends)
    )


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 999), count=st.integers(3, 14), density=st.floats(0, 0.6))
def test_rules_are_kept_and_the_way_never_gets_longer(seed, count, density):
    rng = np.random.default_rng(seed)
    elements, head = bars(rng.uniform(0, 10, (count, 3)))
    pairs = {
        (a, b): 1.0 for a in range(count) for b in range(a + 1, count) if rng.random() < density
    }
    passes = vessel_passes(elements)
    found = shorten_travels(passes, elements, rules_of(pairs, count), head)
    assert sorted(order_of(found)) == list(range(count))
    assert broken(pairs, order_of(found)) == set()
    assert way_between(found, elements) <= way_between(passes, elements) + 1e-9


def test_bars_are_written_to_and_fro_where_nothing_forbids():
    elements, head = bars([(0, 3 * k, 0) for k in (0, 3, 1, 2)], 5.0)
    passes = vessel_passes(elements)
    found = shorten_travels(passes, elements, rules_of({}, len(elements.end)), head)
    assert sorted(order_of(found)) == list(range(len(elements.end)))
    # All one way, as they come: 24 mm; at best to and fro: 9 mm.
    assert way_between(passes, elements) > 23.9
    assert way_between(found, elements) < 12
    own = rules_of({(k, k + 1): 1.0 for k in elements.first[:-1].tolist()}, len(elements.end))
    assert {one.legs[0].step for one in shorten_travels(passes, elements, own, head)} == {1}
