"""Merging of embedded passes: keeps all precedence rules."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.merge import contracted, fewest, merge_passes, pass_rules
from design.toolpath.embedded.schedule import Leg, Pass
from tests.design.toolpath.embedded_parts import pairs_of, parts_of, rules_of
from tests.design.toolpath.shapes import network
from tests.slower import examples


def chain(vessels):
    """Elements of a straight row of vessels, end to end, and each vessel's first and last one."""
    nodes = [(float(k), 0.0, 0.0) for k in range(vessels + 1)]
    pairs = [(k, k + 1) for k in range(vessels)]
    elements = parts_of(network(nodes, pairs, 0.2), EmbeddedOptions()).elements
    ends = [(int(elements.first[k]), int(elements.first[k + 1]) - 1) for k in range(vessels)]
    assert all(low < high for low, high in ends)
    return elements, ends


def forward(ends):
    return Pass((Leg(ends[0], 1, ends[1] - ends[0] + 1),))


def written(passes):
    return [int(e) for one in passes for e in one.elements()]


@pytest.mark.parametrize(("later_waits", "count"), [(False, 1), (True, 2)])
def test_a_later_pass_that_leads_to_an_earlier_one_goes_first_where_it_may(later_waits, count):
    elements, ends = chain(2)
    pairs = dict.fromkeys(ends, 1.0)  # neither may be turned
    if later_waits:
        pairs[ends[1][0], ends[0][0]] = 1.0
    rules = rules_of(pairs, len(elements.end))
    head = np.zeros(2, dtype=np.int64)
    passes = [forward(ends[1]), forward(ends[0])]
    found = merge_passes(passes, pass_rules(passes, elements, rules), elements, head)
    assert len(found) == count
    if count == 1:
        assert written(found) == list(range(len(elements.end)))


def test_a_chain_of_rules_over_a_third_pass_keeps_two_apart():
    elements, ends = chain(3)
    pairs = dict.fromkeys(ends, 1.0)
    pairs |= {(ends[1][0], ends[2][0]): 1.0, (ends[2][0], ends[0][0]): 1.0}
    rules = rules_of(pairs, len(elements.end))
    order = [forward(ends[k]) for k in (1, 2, 0)]
    graph = pass_rules(order, elements, rules)
    found = merge_passes(order, graph, elements, np.array([0, 0, 1]))  # the third by another head
    assert len(found) == 3


@settings(max_examples=examples(60), deadline=None)
@given(seed=st.integers(0, 9999), vessels=st.integers(2, 9), density=st.floats(0, 0.5))
def test_rules_are_kept_and_everything_is_written_once(seed, vessels, density):
    rng = np.random.default_rng(seed)
    elements, ends = chain(vessels)
    rank = rng.permutation(vessels)
    passes = [forward(ends[k]) for k in np.argsort(rank)]
    order = {e: n for n, e in enumerate(written(passes))}
    ones, others = rng.integers(0, len(order), (2, int(density * len(order) ** 1.5)))
    pairs = {
        (a, b) if order[a] < order[b] else (b, a): 1.0
        for a, b in zip(ones.tolist(), others.tolist(), strict=True)
        if a != b
    }
    rules = rules_of(pairs, len(elements.end))
    found = fewest(passes, elements, rules, np.zeros(vessels, dtype=np.int64), rng)
    place = {e: n for n, e in enumerate(written(found))}
    assert len(place) == len(written(found)) == len(elements.end)
    assert all(place[a] < place[b] for a, b in pairs_of(rules))
    assert len(found) <= len(passes)


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 9999), vessels=st.integers(1, 9), count=st.integers(0, 60))
def test_rules_of_passes_are_those_of_their_elements(seed, vessels, count):
    rng = np.random.default_rng(seed)
    elements, ends = chain(vessels)
    drawn = rng.integers(0, len(elements.end), (count, 2))
    rules = rules_of({(int(a), int(b)): 1.0 for a, b in drawn}, len(elements.end))
    passes = [forward(one) for one in ends]
    found = pass_rules(passes, elements, rules)
    own = elements.vessel
    said = [(int(own[a]), int(own[b])) for a, b in pairs_of(rules)]
    for k in range(vessels):
        after = found.after[found.after_begin[k] : found.after_begin[k + 1]].tolist()
        before = found.before[found.before_begin[k] : found.before_begin[k + 1]].tolist()
        assert after == sorted({b for a, b in said if a == k != b})
        assert before == sorted({a for a, b in said if b == k != a})
        assert found.turns[k] == ((k, k) not in said)


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 9999), count=st.integers(0, 60))
def test_rules_of_passes_made_one_are_those_of_their_elements(seed, count):
    rng = np.random.default_rng(seed)
    elements, ends = chain(9)
    drawn = rng.integers(0, len(elements.end), (count, 2))
    rules = rules_of({(int(a), int(b)): 1.0 for a, b in drawn}, len(elements.end))
    legs = [forward(one) for one in ends]
    number = np.concatenate([np.arange(4), rng.integers(0, 4, 5)])
    whole = [
        Pass(tuple(leg for k in np.flatnonzero(number == n) for leg in legs[k].legs))
        for n in range(4)
    ]
    found = contracted(pass_rules(legs, elements, rules), number)
    for one, other in zip(found, pass_rules(whole, elements, rules), strict=True):
        assert np.array_equal(one, other)
