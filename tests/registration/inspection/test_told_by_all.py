"""Stretches with and without ink, by all that a picture tells."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from kernels.arrays import BoolArray
from registration.inspection import ExpectedLines
from registration.inspection.over_ink.thin_change import ThinChange
from registration.inspection.unseen.told_by_all import told_by_all
from registration.inspection.values import Unseen
from registration.inspection.ways import lay_ways

WIDTH, LENGTH = 0.25, 10.0


def _look(came: BoolArray) -> Any:
    one = np.zeros(1, np.int64)
    start, end = np.array([[0.0, 0.0, 0.0]]), np.array([[LENGTH, 0.0, 0.0]])
    ways = lay_ways(ExpectedLines(start, end, np.array([WIDTH]), one, one, one == 0), 0.05)
    share = came[(np.arange(len(ways)) * len(came) // len(ways))]
    none = np.zeros(len(ways), np.bool_)
    change = SimpleNamespace(came=share, still=none, older=None)
    return cast(
        Any,
        SimpleNamespace(
            ways=ways,
            present=np.full(len(ways), np.nan),
            change=change,
            why=np.full(len(ways), Unseen.OLD_INK),
        ),
    )


def _told(came: BoolArray) -> Any:
    look = _look(came)
    none = np.zeros(len(look.ways), np.bool_)
    return told_by_all(look, none, none, ThinChange(none, none))


def test_passing_highlights_do_not_tell_that_ink_came() -> None:
    """A clog to the print's end went on: each highlight of clear ink began its stretch anew."""
    bits = np.zeros(100, np.bool_)
    bits[[8, 9, 40, 41, 77, 78, 97]] = True  # of 0.1 to 0.2 mm, less than three widths
    told = _told(bits)
    assert told.came_mm == told.ink_mm == 0.0
    assert [round(one.length_mm, 1) for one in told.untold] == [LENGTH]


def test_a_stretch_longer_than_three_widths_changed_by_ink() -> None:
    long = np.zeros(100, np.bool_)
    long[20:40] = True
    told = _told(long)
    assert 1.8 < told.came_mm < 2.2
    assert [round(one.length_mm) for one in told.tail] == [6]


def test_a_stretch_that_looks_bare_is_not_told_as_ink_by_the_shade_of_lines_beside_it() -> None:
    """Bubbles of 2.1 mm between lines that touch changed the picture, and counted as ink."""
    long = np.zeros(100, np.bool_)
    long[20:42] = True
    look = _look(long)
    look.why[:], look.present[:] = int(Unseen.SEEN), 0.15
    none = np.zeros(len(look.ways), np.bool_)
    seen = np.abs(look.ways.along - 3.1) > 1.2  # around them, with a little of what is unseen
    told = told_by_all(look, seen, none, ThinChange(none, none))
    assert told.came_mm == 0.0
    assert [round(one.length_mm, 1) for one in told.doubted] == [2.4]
    look.present[:] = 0.9
    told = told_by_all(look, seen, none, ThinChange(none, none))
    assert round(told.came_mm, 1) == 2.2
    assert not told.doubted
