"""Checker of print strokes: detects wrong ones."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.checkers.link_join import STEPS_PER_MM, Strokes, astray

ENDS = np.array([[0, 0, 0, 0], [80, 0, 0, 10], [80, 0, 0, 5], [80, 80, 0, 20], [0, 80, 0, 30]])


def motion(ends):
    mm = ends / STEPS_PER_MM
    begin = np.vstack([mm[:1], mm[:-1]])
    return SimpleNamespace(
        start=begin[:, :3], end=mm[:, :3], plunger_start=begin[:, 3], plunger_end=mm[:, 3]
    )


def test_what_was_done_as_foreseen_is_not_astray():
    assert astray(Strokes.of(ENDS), motion(ENDS)) == 0


def test_pause_between_two_strokes_is_left_out():
    lifted = np.array([[80, 0, 0, -5], [80, 0, 400, -5], [80, 0, 0, -5], [80, 0, 0, 5]])
    assert astray(Strokes.of(ENDS), motion(np.vstack([ENDS[:3], lifted, ENDS[3:]]))) == 0


@pytest.mark.parametrize("axis", range(4))
def test_stroke_that_ends_or_doses_elsewhere_is_seen(axis):
    wrong = ENDS.copy()
    wrong[3, axis] += 3
    assert astray(Strokes.of(ENDS), motion(wrong)) >= 1


def test_stroke_done_twice_or_left_out_is_seen():
    twice = np.vstack([ENDS, [[80, 80, 0, 30]], ENDS[-1:]])
    assert astray(Strokes.of(ENDS), motion(twice)) >= 1
    assert astray(Strokes.of(ENDS), motion(np.delete(ENDS, 3, axis=0))) >= 1
    assert astray(Strokes.of(ENDS), motion(ENDS[:-1]), unfinished=1) == 0
