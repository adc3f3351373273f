"""Cutting and conflicts against slow, obvious oracles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.embedded.order import order_pieces
from design.toolpath.embedded.pieces import cut, turning_points
from design.toolpath.embedded.shaft import Conflicts, Needle, find_conflicts
from tests.design.toolpath.shapes import polyline, random_tree

SHAFT = 0.2


def naive_conflicts(pieces, overlap):
    """Harm in mm by comparing all pairs of samples."""
    harm = np.zeros((len(pieces), len(pieces)))
    samples = []
    for piece in pieces:
        length = np.linalg.norm(piece.points[1] - piece.points[0])
        count = int(np.ceil(length / (SHAFT / 2))) + 1
        samples.append((np.linspace(piece.points[0], piece.points[1], count), length / count))
    for p, one in enumerate(pieces):
        for q, other in enumerate(pieces):
            if p == q:
                continue
            reach = np.sqrt(2) * (SHAFT + max(one.radius[0], other.radius[0]))
            reach += overlap * max(one.radius[0], other.radius[0])
            shared = [
                one.points[0 if node == one.ends[0] else 1]
                for node in set(one.ends) & set(other.ends)
            ]
            for b in samples[p][0]:
                hit = False
                for a in samples[q][0]:
                    near = np.hypot(*(a - b)[:2]) < SHAFT + other.radius[0]
                    above = a[2] + other.radius[0] > b[2]
                    joint = any(
                        max(np.linalg.norm(a - n), np.linalg.norm(b - n)) < reach for n in shared
                    )
                    hit |= near and above and not joint
                harm[p, q] += samples[p][1] * hit
    return harm


@pytest.mark.parametrize(("seed", "overlap"), [(0, 0.0), (1, 1.0), (2, 2.0)])
def test_conflicts_are_those_of_all_pairs(seed, overlap):
    pieces = cut(random_tree(8, 5, seed, 0.1))
    found = find_conflicts(pieces, Needle(SHAFT, overlap))
    harm = np.zeros((len(pieces), len(pieces)))
    harm[found.first, found.second] = found.harm_mm
    assert harm.any()
    assert harm == pytest.approx(naive_conflicts(pieces, overlap))


def test_a_piece_that_folds_over_itself_is_told():
    flat = np.array([[0.0, 0, 0], [5, 0, 0], [5, 0.25, 0], [0, 0.25, 0]])
    found = find_conflicts(cut(polyline(flat, 0.15)), Needle(SHAFT, 0.0))
    assert found.own_mm[0] == pytest.approx(5, abs=0.2)


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=60), st.floats(0.01, 2))
def test_between_turning_points_height_goes_one_way(height, tolerance):
    height = np.array(height)
    turns = turning_points(height, tolerance)
    assert turns[0] == 0
    assert turns[-1] == len(height) - 1
    for low, high in pairwise(turns):
        part = height[low : high + 1]
        upward = (np.maximum.accumulate(part) - part).max()
        downward = (part - np.minimum.accumulate(part)).max()
        assert min(upward, downward) <= tolerance


def test_cut_loses_no_length_and_goes_upward():
    turn = np.linspace(0, 20, 400)
    wave = np.column_stack([turn, 0 * turn, 2 * np.sin(turn)])
    net = polyline(wave, np.linspace(0.2, 0.3, 400))
    pieces = cut(net)
    length = sum(np.linalg.norm(np.diff(p.points, axis=0), axis=1).sum() for p in pieces)
    assert length == pytest.approx(net.lengths().sum())
    assert len(pieces) == 7
    assert all(piece.points[-1, 2] > piece.points[0, 2] for piece in pieces)
    ends = [node for piece in pieces for node in piece.ends]
    assert sorted(ends.count(node) for node in set(ends)) == [1, 1, *[2] * 6]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 500), count=st.integers(1, 12), density=st.floats(0, 1))
def test_rules_without_a_cycle_are_all_kept(seed, count, density):
    rng = np.random.default_rng(seed)
    pieces = cut(random_tree(count, 10, 0, 0.1))
    rank = rng.permutation(len(pieces))
    pairs = [
        (a, b)
        for a in range(len(pieces))
        for b in range(len(pieces))
        if rank[a] < rank[b] and rng.random() < density
    ]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    rules = Conflicts(first, second, rng.random(len(pairs)), np.zeros(len(pieces)))
    order = order_pieces(pieces, rules)
    place = {piece.vessel: k for k, piece in enumerate(order)}
    assert sorted(place) == list(range(len(pieces)))
    assert all(place[pieces[a].vessel] < place[pieces[b].vessel] for a, b in pairs)


def test_only_the_lightest_rule_of_a_cycle_is_broken():
    pieces = cut(random_tree(3, 10, 0, 0.1))  # five pieces, the last two outside the cycle
    first, second = np.array([0, 1, 2, 2, 3]), np.array([1, 2, 0, 3, 4])
    harm = np.array([3.0, 1.0, 2.0, 0.1, 0.1])
    order = order_pieces(pieces, Conflicts(first, second, harm, np.zeros(5)))
    place = {piece.vessel: k for k, piece in enumerate(order)}
    broken = [place[a] > place[b] for a, b in zip(first, second, strict=True)]
    assert broken == [False, True, False, False, False]
