"""Thin stretches: how far they go, how much ink they lack, and what two pictures show."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.observe.deciding.evidence import Thin, seen_twice
from printctl.observe.judging import low_stretches, runs_below, thin_lines
from registration.inspection import Stations, Stretch

STEP = 0.15


def stations(strokes=2, each=60):
    m = strokes * each
    none, full = np.zeros(m), np.ones(m)
    row = np.repeat(np.arange(strokes), each)
    along = np.tile((np.arange(each) + 0.5) * STEP, strokes)
    return Stations(
        np.zeros((m, 2)), none, np.zeros((m, 2)), row, row, along, full * STEP,
        full * 0.25, full * 0.25, full * 0.01, none, full, full > 0, row * 0,
    )  # fmt: skip


def thin(kind="thin", low=3.0, high=3.6, stroke=1):
    return Stretch(kind, stroke, low, high, 0.7, 0.02, 1e-9)


def test_a_thin_stretch_goes_as_far_as_the_line_is_thin():
    given, rng = stations(), np.random.default_rng(0)
    ratio = 1 + 0.04 * rng.standard_normal(120)
    ratio[70:100] -= 0.3  # 1.5 to 6 mm of stroke 1
    (found,) = thin_lines((thin(),), given, np.ones(120, bool), ratio)
    assert found.stroke == 1
    assert (found.from_mm, found.to_mm) == pytest.approx((1.5, 6.0), abs=0.3)
    assert found.missing == pytest.approx(0.3, abs=0.03)


def test_stretches_of_one_thin_line_are_one():
    given, ratio = stations(), np.full(120, 0.7)
    found = thin_lines((thin(), thin(low=5.0, high=6.0)), given, np.ones(120, bool), ratio)
    assert [(one.from_mm, round(one.to_mm, 6)) for one in found] == [(0.0, 9.0)]


def test_thick_stretches_and_places_that_tell_nothing_fill_nothing():
    given, ratio = stations(), np.full(120, 0.7)
    assert thin_lines((thin("thick"),), given, np.ones(120, bool), ratio) == ()
    assert thin_lines((thin(),), given, np.zeros(120, bool), ratio * np.nan) == ()


def test_what_one_picture_alone_shows_isnt_filled_up():
    one, other = Thin(1, 2.0, 4.0, 0.3), Thin(1, 6.0, 8.0, 0.3)
    assert seen_twice((one, other), (Thin(1, 3.0, 5.0, 0.3), Thin(2, 6.0, 8.0, 0.3))) == (one,)


def test_ink_that_stands_low_on_older_ink_is_told_where_no_width_is() -> None:
    given = stations()
    given.present[75:105] = 0.8  # 2.25 to 6.75 mm of stroke 1
    given.present[10:20] = 0.8  # 1.5 mm: as droops are
    assert low_stretches(given, 0.15) == ()  # widths tell it
    given.width_mm[:] = np.nan
    (found,) = low_stretches(given, 0.15)
    assert found.stroke == 1
    assert (found.from_mm, found.to_mm) == pytest.approx((2.25, 6.75), abs=0.31)
    assert low_stretches(given, 0.25) == ()


def test_lines_below_a_level_are_found_to_their_ends():
    given, rng = stations(), np.random.default_rng(1)
    ratio = 1 + 0.04 * rng.standard_normal(120)
    ratio[70:] -= 0.3  # of stroke 1, from 1.5 mm on
    told = np.ones(120, bool)
    told[[60, 61, 118, 119]] = False  # at its ends no width is told
    (found,) = runs_below(given, told, ratio, 0.85)
    assert (found.stroke, found.to_mm) == (1, pytest.approx(9.0))
    assert found.from_mm == pytest.approx(1.5, abs=0.3)
    assert runs_below(given, told, np.ones(120), 0.85) == ()
