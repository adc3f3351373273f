"""Thin stretches: how far they go, how much ink they lack, and what two pictures show."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.observe.deciding.thin import Thin, seen_twice
from printctl.observe.thin_lines import low_stretches, thin_lines
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
