"""Shortened travels between embedded passes: keep all precedence rules."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.merge import CLIMB, shorten_travels
from design.toolpath.embedded.schedule import Leg, Pass
from tests.design.toolpath.embedded_parts import parts_of, rules_of
from tests.design.toolpath.shapes import network
from tests.slower import examples


def bars(places, long_mm=0.1):
    """Elements of bars along x that begin at the places (n, 3), and one head for all."""
    places = np.asarray(places, float)
    nodes = [tuple(p) for place in places for p in (place, place + [long_mm, 0, 0])]
    pairs = [(2 * k, 2 * k + 1) for k in range(len(places))]
    elements = parts_of(network(nodes, pairs, 0.2), EmbeddedOptions()).elements
    return elements, np.zeros(len(places), dtype=np.int64)


def passes_of(elements):
    low = elements.first.tolist()
    return [Pass((Leg(a, 1, b - a),)) for a, b in itertools.pairwise(low)]


def vessels(passes, elements):
    return [int(elements.vessel[one.legs[0].element]) for one in passes]


def length(passes, elements):
    total = 0.0
    ends = [_ends(one, elements) for one in passes]
    for (_, a), (b, _) in itertools.pairwise(ends):
        total += np.hypot(*(a - b)[:2]) + CLIMB * abs((a - b)[2])
    return total


def _ends(one, elements):
    (leg,) = one.legs
    line = elements.point[elements.end[leg.elements()]]
    return (line[0, 0], line[-1, 1]) if leg.step > 0 else (line[0, 1], line[-1, 0])


def test_bars_are_written_to_and_fro_where_nothing_forbids():
    elements, head = bars([(0, 3 * k, 0) for k in (0, 3, 1, 2)], 5.0)
    found = shorten_travels(passes_of(elements), elements, rules_of({}, len(elements.end)), head)
    assert sorted(vessels(found, elements)) == [0, 1, 2, 3]
    assert {one.legs[0].step for one in found} == {1, -1}
    # All one way, as they come: 24 mm; at best to and fro: 9 mm.
    assert length(passes_of(elements), elements) > 23.9
    assert length(found, elements) < 12


def test_a_pass_whose_own_rules_forbid_it_isnt_turned():
    elements, head = bars([(0, 3 * k, 0) for k in range(4)], 0.5)
    low = elements.first[:-1].tolist()
    own = rules_of({(k, k + 1): 1.0 for k in low}, len(elements.end))
    assert all(
        one.legs[0].step == 1 for one in shorten_travels(passes_of(elements), elements, own, head)
    )


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 999), count=st.integers(3, 14), density=st.floats(0, 0.6))
def test_rules_are_kept_and_the_way_never_gets_longer(seed, count, density):
    rng = np.random.default_rng(seed)
    elements, head = bars(rng.uniform(0, 10, (count, 3)))
    first = elements.first[:-1].tolist()
    pairs = {
        (first[a], first[b]): 1.0
        for a in range(count)
        for b in range(a + 1, count)
        if rng.random() < density
    }
    passes = passes_of(elements)
    found = shorten_travels(passes, elements, rules_of(pairs, len(elements.end)), head)
    place = {vessel: k for k, vessel in enumerate(vessels(found, elements))}
    assert sorted(place) == list(range(count))
    owner = elements.vessel
    assert all(place[int(owner[a])] < place[int(owner[b])] for a, b in pairs)
    assert length(found, elements) <= length(passes, elements) + 1e-9


def test_heads_arent_changed_more_often_for_a_shorter_way():
    elements, _ = bars([(0, 0, 0), (0, 6, 0), (0, 1, 0), (0, 7, 0)])
    head = np.array([0, 0, 1, 1])
    found = shorten_travels(passes_of(elements), elements, rules_of({}, len(elements.end)), head)
    tools = head[vessels(found, elements)]
    assert (np.diff(tools) != 0).sum() == 1
