"""Rows that a height map lacks, by an earlier map of the same place."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.checkers.profiler_painter import profiled
from registration.inspection.heights.lost_rows import gone_mm2, lost_rows
from registration.inspection.values import FloatImage

_CELL = (0.02, 0.02)


def _two(seed: int) -> tuple[FloatImage, FloatImage]:
    """Two maps of one lattice, of other noise."""
    map_ = profiled(seed, "lattice", size=4.0, px=0.02)
    noise = np.random.default_rng(seed).normal(0.0, 0.004, (2, *map_.heights.shape))
    first, second = map_.heights + noise
    return first.astype(np.float32), second.astype(np.float32)


@pytest.mark.parametrize("axis", [0, 1])
def test_rows_lost_in_the_middle_are_told_by_size_and_place(axis: int) -> None:
    now, last = _two(3)
    short = np.delete(now, slice(150, 165), axis=axis)
    lost = lost_rows(short, last, np.ones(last.shape, np.bool_), _CELL)
    assert lost[axis] == 15
    assert lost[1 - axis] == 0


def test_a_whole_map_and_one_that_ended_early_lack_nothing_between() -> None:
    now, last = _two(3)
    still = np.ones(last.shape, np.bool_)
    assert lost_rows(now, last, still, _CELL) == (0, 0)
    assert lost_rows(now[:-15], last, still, _CELL) == (0, 0)
    assert lost_rows(now[:, :-15], last, still, _CELL) == (0, 0)
    assert lost_rows(now[:-3], last, still, _CELL) == (0, 0)  # 60 µm


@pytest.mark.parametrize("axis", [0, 1])
def test_rows_that_were_lost_and_filled_up_are_told_by_what_is_gone(axis: int) -> None:
    now, last = _two(3)
    short = np.delete(now, slice(80, 92), axis=axis)
    end = np.take(short, range(-12, 0), axis=axis)
    filled = np.concatenate([short, end], axis=axis)
    stretched = np.take(short, np.linspace(0, short.shape[axis] - 1, 200).round().astype(int), axis)
    assert gone_mm2(now - last, 0.1, _CELL) == 0.0
    assert gone_mm2(filled[:200, :200] - last[:200, :200], 0.1, _CELL) > 0.3
    whole = np.take(now, range(200), axis=axis)
    assert gone_mm2(stretched - np.take(last, range(200), axis=axis), 0.1, _CELL) > 0.3
    assert gone_mm2(whole - np.take(last, range(200), axis=axis), 0.1, _CELL) == 0.0
