"""Merged moves: all long enough, and no other choice of vertices cuts off less."""

from itertools import combinations, pairwise

import numpy as np
import pytest

from design.toolpath.gcode.merge import long_enough
from kernels.arrays import FloatArray
from tests.slower import first_of


def _cut(way: FloatArray, chosen: tuple[int, ...]) -> float:
    """Squared distances of the left out vertices from the chosen way, by half the way beside."""
    total = 0.0
    for begin, end in pairwise(chosen):
        a, c = way[begin, :3], way[end, :3]
        for v in range(begin + 1, end):
            share = np.clip((way[v, :3] - a) @ (c - a) / ((c - a) @ (c - a)), 0.0, 1.0)
            away = way[v, :3] - a - share * (c - a)
            beside = np.abs(np.diff(way[v - 1 : v + 2, :3], axis=0)).sum()
            total += 0.5 * beside * float(away @ away)
    return total


def _best(way: FloatArray, least: float) -> float | None:
    """Least that any choice with long enough moves cuts off; None where there is none."""
    last = len(way) - 1
    found = [
        _cut(way, chosen)
        for count in range(last)
        for inner in combinations(range(1, last), count)
        for chosen in [(0, *inner, last)]
        if (np.abs(np.diff(way[list(chosen)], axis=0)).max(axis=1) >= least).all()
    ]
    return min(found, default=None)


@pytest.mark.parametrize("seed", first_of(range(40), 10))
def test_no_other_choice_of_vertices_cuts_off_less(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, 0.6, 9))
    step = rng.uniform(1.0, 9.0, 9)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    way = np.zeros((10, 4))
    way[1:, :2] = np.cumsum(step, axis=0)
    keep = long_enough(way, np.zeros(9, dtype=np.int64), 7.0)
    chosen = (0, *(np.flatnonzero(keep) + 1).tolist())
    assert chosen[-1] == 9  # a run ends where it ended
    best = _best(way, 7.0)
    if best is None:
        assert len(chosen) == 2
        return
    assert (np.abs(np.diff(way[list(chosen)], axis=0)).max(axis=1) >= 7.0).all()
    assert _cut(way, chosen) == pytest.approx(best)


def test_runs_are_merged_apart_and_what_isn_t_one_stays() -> None:
    way = np.zeros((9, 4))
    way[1:, 0] = np.cumsum([3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 20.0, 20.0])
    keep = long_enough(way, np.array([0, 0, 0, -1, -1, 1, 1, 2]), 7.0)
    assert keep.tolist() == [False, False, True, True, True, False, True, True]
