"""Missing ink beside a sure gap is found by a hidden Markov model along the written stroke."""

from __future__ import annotations

import numpy as np
import pytest

from kernels.arrays import BoolArray, FloatArray
from registration.inspection import ExpectedLines, Gap
from registration.inspection.gaps.along_strokes import covered_share, reached
from registration.inspection.ways import Ways, lay_ways

WIDTH, STEP = 0.2, 0.05


def lines(*strokes: tuple[tuple[float, float], tuple[float, float]]) -> ExpectedLines:
    """Straight strokes, one piece each."""
    start, end = (np.array([[*one[k], 0.0] for one in strokes]) for k in (0, 1))
    number = np.arange(len(strokes))
    fresh = np.ones(len(strokes), dtype=np.bool_)
    return ExpectedLines(start, end, np.full(len(strokes), WIDTH), number, number, fresh)


def apart(*lengths: float) -> Ways:
    """Parallel strokes, 1 mm apart."""
    return lay_ways(lines(*[((0.0, k), (long, k)) for k, long in enumerate(lengths)]), STEP)


def gap(stroke: int, begin: float, end: float) -> Gap:
    return Gap(stroke, begin, end, (begin, stroke), (end, stroke), 0.02, 1e-12)


def seen_as(ways: Ways, *levels: tuple[int, float, float, float]) -> tuple[FloatArray, BoolArray]:
    """Levels along strokes (stroke, from, to, level), else 1; and which are told beyond doubt."""
    level, clear = np.ones(len(ways)), np.ones(len(ways), dtype=np.bool_)
    for stroke, begin, end, value in levels:
        own = (ways.stroke == stroke) & (ways.along > begin) & (ways.along < end)
        level[own] = value
        clear[own] = value < 0.01
    return level, clear


def test_unclear_ink_of_low_level_beside_a_gap_is_missing_as_well() -> None:
    ways = apart(10.0)
    level, clear = seen_as(ways, (0, 0, 3, 0.0), (0, 3, 8, 0.15))
    gaps, lost = reached([gap(0, 0.0, 3.0)], level, clear, 0.12, ways)
    assert [(one.from_mm, one.p_value) for one in gaps] == [(0.0, 1e-12)]
    assert gaps[0].to_mm == pytest.approx(8.0, abs=0.1)
    assert gaps[0].end_mm == pytest.approx((gaps[0].to_mm, 0.0), abs=1e-6)
    assert not (lost & clear).any()


@pytest.mark.parametrize("level", [0.5, 0.7, 1.0, np.nan])
def test_thin_or_sound_or_hidden_ink_behind_a_gap_stays_unclear(level: float) -> None:
    ways = apart(10.0)
    seen, clear = seen_as(ways, (0, 0, 3, 0.0), (0, 3, 8, level))
    only = [gap(0, 0.0, 3.0)]
    gaps, lost = reached(only, seen, clear, 0.12, ways)
    assert gaps == only
    assert not lost.any()


def test_what_is_hidden_between_two_gaps_is_missing_if_it_is_short() -> None:
    for length, joined in ((1.0, True), (8.0, False)):
        ways = apart(14.0)
        level, clear = seen_as(
            ways, (0, 0, 2, 0.0), (0, 2, 2 + length, np.nan), (0, 2 + length, 12, 0.0)
        )
        two = [gap(0, 0.0, 2.0), gap(0, 2.0 + length, 12.0)]
        gaps, _ = reached(two, level, clear, 0.12, ways)
        assert len(gaps) == (1 if joined else 2)
        assert (gaps[0].from_mm, gaps[-1].to_mm) == (0.0, 12.0)


def test_a_stroke_between_two_that_lost_ink_is_missing_by_its_own_level() -> None:
    ways = apart(5.0, 4.0, 5.0)
    level, clear = seen_as(ways, (0, 3, 5, 0.0), (1, 0, 4, 0.1), (2, 0, 2, 0.0))
    gaps, _ = reached([gap(0, 3.0, 5.0), gap(2, 0.0, 2.0)], level, clear, 0.12, ways)
    assert [one.stroke for one in gaps] == [0, 1, 2]
    assert (gaps[1].from_mm, gaps[1].to_mm) == pytest.approx((0.0, 4.0), abs=0.01)
    assert gaps[1].p_value < 1e-9


def test_without_a_sure_gap_nothing_is_judged_anew() -> None:
    ways = apart(10.0)
    level, clear = seen_as(ways, (0, 3, 8, 0.0))
    gaps, lost = reached([], level, np.zeros_like(clear), 0.12, ways)
    assert not gaps
    assert not lost.any()


def test_ends_of_neighbours_that_reach_into_a_missing_line_are_not_its_ink() -> None:
    """Rows of an infill end on the wall's line: each end shows as half of a line's ink there."""
    rows = [((x, 0.05), (x, 3.0)) for x in np.arange(3.2, 9.0, 0.4)]
    ways = lay_ways(lines(((0.0, 0.0), (10.0, 0.0)), *rows), STEP)
    cover = covered_share(ways)
    wall = ways.stroke == 0
    assert cover[wall & (ways.along < 2.9)].max() == 0.0
    level, clear = seen_as(ways, (0, 0, 3, 0.0))
    unclear = wall & (ways.along > 3.0) & (ways.along < 9.0)
    level[unclear], clear[unclear] = cover[unclear], False
    gaps, _ = reached([gap(0, 0.0, 3.0)], level, clear, 0.12, ways)
    assert gaps[0].to_mm == pytest.approx(9.0, abs=0.3)


def test_a_line_beside_or_ahead_of_a_place_does_not_cover_it() -> None:
    cover = covered_share(apart(3.0, 3.0))
    assert cover.max() == 0.0
    crossing = lay_ways(lines(((0.0, 0.0), (4.0, 0.0)), ((2.0, -2.0), (2.0, 2.0))), STEP)
    cover = covered_share(crossing)
    middle = np.abs(crossing.point[:, :2] - [2.0, 0.0]).max(axis=1) < 0.04
    assert cover[middle].min() == 1.0
    assert cover[np.linalg.norm(crossing.point[:, :2] - [2.0, 0.0], axis=1) > 0.3].max() == 0.0


def test_a_stroke_between_two_that_lost_ink_but_not_seen_itself_is_not_believed() -> None:
    ways = apart(5.0, 1.0, 5.0)
    level, clear = seen_as(ways, (0, 3, 5, 0.0), (1, 0, 1, np.nan), (2, 0, 2, 0.0))
    gaps, _ = reached([gap(0, 3.0, 5.0), gap(2, 0.0, 2.0)], level, clear, 0.12, ways)
    assert all(one.p_value > 1e-4 for one in gaps if one.stroke == 1)
