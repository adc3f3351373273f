"""Embedded schedule: every element written once, precedence kept."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.embedded.elements import elements_of
from design.toolpath.embedded.improve import broken_rules
from design.toolpath.embedded.rules import find_rules, one_way
from design.toolpath.embedded.schedule import Leg, Scheduler, start_walk, undo_write, write_stretch
from tests.design.toolpath.embedded_parts import pairs_of, parts_of, rules_of, trail
from tests.design.toolpath.shapes import cage, network, random_tree
from tests.design.toolpath.test_embedded_rules import random_rules
from tests.slower import examples

TREE = elements_of(random_tree(4, 8, 0, 0.1), 0.8)
COUNT = len(TREE.end)
ONE_HEAD = np.zeros(len(TREE.first) - 1, dtype=np.int64)


def order_of(passes):
    return np.concatenate([one.elements() for one in passes]).tolist()


def naive_broken(pairs, order):
    when = {element: place for place, element in enumerate(order)}
    return {(i, j) for i, j in pairs if when[j] < when[i]}


def test_a_leg_counts_its_elements_either_way():
    assert Leg(4, 1, 3).elements().tolist() == [4, 5, 6]
    assert Leg(4, -1, 3).elements().tolist() == [4, 3, 2]
    assert (Leg(4, 1, 3).last, Leg(4, -1, 3).last, Leg(7, -1, 1).last) == (6, 2, 7)


@settings(max_examples=examples(40), deadline=None)
@given(seed=st.integers(0, 999), density=st.floats(0, 0.3))
def test_rules_that_can_all_be_kept_are_kept(seed, density):
    rules, pairs = random_rules(seed, COUNT, density, ranked=True)
    passes = Scheduler(TREE, rules, ONE_HEAD).run()
    assert sorted(order_of(passes)) == list(range(COUNT))
    assert naive_broken(pairs, order_of(passes)) == set()
    assert len(broken_rules(rules, passes)[0]) == 0
    for one in passes:
        assert len(trail(one, TREE)) == len(one.elements()) + 1


@settings(max_examples=examples(15), deadline=None)
@given(seed=st.integers(0, 999), density=st.floats(0, 0.5))
def test_rules_that_contradict_each_other_still_let_everything_be_written(seed, density):
    rules, pairs = random_rules(seed, COUNT, density, ranked=False)
    passes = Scheduler(TREE, rules, ONE_HEAD).run()
    order = order_of(passes)
    assert sorted(order) == list(range(COUNT))
    first, after = broken_rules(rules, passes)
    assert set(zip(first.tolist(), after.tolist(), strict=True)) == naive_broken(pairs, order)


def test_what_is_free_is_written_in_one_pass_through_its_nodes():
    line = elements_of(
        network([(k, 0, 0) for k in range(5)], [(0, 1), (2, 1), (2, 3), (3, 4)], 0.2), 0.3
    )
    passes = Scheduler(line, rules_of({}, len(line.end)), np.zeros(4, dtype=np.int64)).run()
    assert len(passes) == 1
    assert len(passes[0].legs) == 4


def test_a_pass_doesnt_go_on_with_another_head():
    line = elements_of(network([(k, 0, 0) for k in range(4)], [(0, 1), (1, 2), (2, 3)], 0.2), 0.3)
    passes = Scheduler(line, rules_of({}, len(line.end)), np.array([0, 1, 0])).run()
    heads = [{int(line.vessel[e]) == 1 for e in one.elements()} for one in passes]
    assert all(len(own) == 1 for own in heads)
    assert len(passes) == 3


def test_the_lightest_rule_of_a_cycle_is_broken():
    bars = elements_of(
        network([(x, k, 0) for k in range(3) for x in (0, 1)], [(0, 1), (2, 3), (4, 5)], 0.2), 1.0
    )
    pairs = {(0, 1): 3.0, (1, 2): 1.0, (2, 0): 2.0}
    passes = Scheduler(bars, rules_of(pairs, 3), np.zeros(3, dtype=np.int64)).run()
    assert naive_broken(pairs, order_of(passes)) == {(1, 2)}


def test_vessels_that_wait_for_each_other_are_cut():
    """Of two bars each has one half that waits for the other's: two passes can't do, three can."""
    bars = elements_of(
        network([(x, k, 0) for k in range(2) for x in (0, 1)], [(0, 1), (2, 3)], 0.2), 0.5
    )
    pairs = {(0, 2): 1.0, (3, 1): 1.0}
    passes = Scheduler(bars, rules_of(pairs, 4), np.zeros(2, dtype=np.int64)).run()
    assert naive_broken(pairs, order_of(passes)) == set()
    assert len(passes) == 3


def test_the_rules_of_real_networks_that_can_be_kept_are_kept():
    for net in (random_tree(10, 9, 4, 0.1), cage(6, 3.0, 4.0)):
        parts = parts_of(net, EmbeddedOptions())
        found = find_rules(parts.elements, parts.squares, parts.meetings, parts.needle)
        rules = one_way(found, parts.elements.vessel)
        head = np.zeros(net.vessel_count, dtype=np.int64)
        passes = Scheduler(parts.elements, rules, head).run()
        assert naive_broken(pairs_of(rules), order_of(passes)) == set()
        assert len(passes) < net.vessel_count
        points = [trail(one, parts.elements) for one in passes]
        assert sum(len(one) - 1 for one in points) == len(parts.elements.end)


def naive_walk(element, step, written, pairs):
    """Elements one after another until the vessel ends, or ink, or one that waits."""
    vessel, done = TREE.vessel[element], []
    while 0 <= element < COUNT and TREE.vessel[element] == vessel and element not in written:
        waits = [i for i, j in pairs if j == element and i not in written and i not in done]
        if waits:
            return len(done), element
        done.append(element)
        element += step
    return len(done), -1


@settings(max_examples=examples(40), deadline=None)
@given(
    seed=st.integers(0, 999),
    density=st.floats(0, 0.1),
    starts=st.lists(st.tuples(st.integers(0, COUNT - 1), st.sampled_from([1, -1])), max_size=8),
)
def test_a_walk_goes_as_far_as_it_may_and_can_be_taken_back(seed, density, starts):
    rules, pairs = random_rules(seed, COUNT, density, ranked=False)
    progress = start_walk(rules)
    written: set[int] = set()
    for element, step in starts:
        before = progress.written.copy(), progress.waiting.copy()
        found = write_stretch(element, step, TREE, rules, progress)
        assert found == naive_walk(element, step, written, pairs)
        undo_write(element, step, found[0], rules, progress)
        assert np.array_equal(progress.written, before[0])
        assert np.array_equal(progress.waiting, before[1])
        write_stretch(element, step, TREE, rules, progress)
        written |= set(Leg(element, step, found[0]).elements().tolist())
        assert set(np.flatnonzero(progress.written).tolist()) == written
