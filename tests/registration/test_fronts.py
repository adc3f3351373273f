"""Leak search fronts, against plain Python Dijkstra."""

from __future__ import annotations

import heapq
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from registration.measuring.topology.gel_paths import BARRIER, UNREACHED, grow, path_cost

STEP, MOST = 0.05, 0.4
SHAPE = (7, 9, 11)


def scene(seed: int, levels: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Gel with barriers between two lumens and an outside; of few levels of evidence ways tie."""
    rng = np.random.default_rng(seed)
    label = np.full(SHAPE, UNREACHED, dtype=np.int32)
    label[rng.random(SHAPE) < 0.1] = BARRIER
    label[0], label[3, 4, :3], label[5, 2:4, 8] = -1, 0, 1
    return label, (rng.integers(0, levels, SHAPE) / (levels - 1)).astype(np.float32)


def naive(
    label: NDArray[np.int32], mean: NDArray[np.float32]
) -> tuple[dict[tuple[int, ...], np.float32], dict[tuple[int, ...], tuple[int, ...]]]:
    """Cost and voxel before of each that a front reaches."""
    cost = {place: np.float32(0) for place in product(*map(range, SHAPE)) if label[place] >= -1}
    before: dict[tuple[int, ...], tuple[int, ...]] = {}
    waiting, done = [(value, place) for place, value in cost.items()], set()
    heapq.heapify(waiting)
    while waiting:
        value, here = heapq.heappop(waiting)
        if here in done:
            continue
        done.add(here)
        for way in product((-1, 0, 1), repeat=3):
            there = tuple(int(a + b) for a, b in zip(here, way, strict=True))
            if not all(0 <= a < n for a, n in zip(there, SHAPE, strict=True)):
                continue
            if label[there] != UNREACHED or there in done:
                continue
            # A wall has no evidence of its own.
            both = 0.5 * (mean[here] + mean[there]) if here in before else mean[there]
            length = STEP * np.sqrt(float(np.abs(way).sum()))
            new = np.float32(value + length * path_cost(float(both)))
            if new < MOST and new < cost.get(there, np.inf):
                cost[there], before[there] = new, here
                heapq.heappush(waiting, (new, there))
    return cost, before


@pytest.mark.parametrize(("seed", "levels"), [(0, 2), (1, 3), (2, 1000)])
def test_fronts_take_the_cheapest_ways_and_of_equal_ones_the_first(seed: int, levels: int) -> None:
    label, mean = scene(seed, levels)
    expected, before = naive(label, mean)
    grown = label.copy()
    cost, length, gel, worst, parent = grow(grown, mean, STEP, MOST)
    assert 100 < len(before) < label.size
    for place in product(*map(range, SHAPE)):
        flat = int(np.ravel_multi_index(place, SHAPE))
        if place not in before:
            assert parent[flat] == -1
            assert grown[place] == label[place]
            continue
        last = before[place]
        assert cost[place] == expected[place]
        assert parent[flat] == np.ravel_multi_index(last, SHAPE)
        assert grown[place] == grown[last]
        apart = STEP * float(np.linalg.norm(np.subtract(place, last)))
        assert length[place] == pytest.approx(length[last] + apart, rel=1e-5)
        assert worst[place] == max(worst[last], mean[place])
        both = 0.5 * (mean[last] + mean[place]) if last in before else mean[place]
        assert gel[place] == pytest.approx(gel[last] + apart * both, rel=1e-5, abs=1e-6)
