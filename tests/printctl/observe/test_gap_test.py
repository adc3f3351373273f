"""Gaps are believed at a stated rate, and only where both pictures show them."""

import numpy as np

from printctl.observe.deciding import GapTest, confirmed_gaps
from registration.inspection.values import Gap

TEST = GapTest()


def gap_of(stroke, from_mm, to_mm, p_value):
    return Gap(stroke, from_mm, to_mm, (from_mm, 0.0), (to_mm, 0.0), 0.01, p_value)


def test_a_second_picture_must_show_it_too():
    gap = gap_of(3, 1.0, 2.0, 1e-9)
    elsewhere = [gap_of(4, 1.0, 2.0, 1e-9), gap_of(3, 1.8, 3.0, 1e-9)]
    assert confirmed_gaps([gap], 500, [], TEST) == ()
    assert confirmed_gaps([gap], 500, elsewhere, TEST) == ()


def test_of_a_gap_that_one_picture_shows_longer_what_both_show_is_mended():
    gap, two = gap_of(3, 1.0, 9.0, 1e-9), [gap_of(3, 1.0, 2.5, 1e-9), gap_of(3, 8.5, 9.0, 1e-9)]
    both = confirmed_gaps([gap], 500, two, TEST)
    assert [(one.from_mm, one.to_mm) for one in both] == [(1.0, 2.5), (8.5, 9.0)]
    assert both[0].end_mm == (2.5, 0.0)
    assert confirmed_gaps([gap], 500, [gap_of(3, 8.9, 9.9, 1e-9)], TEST) == ()


def test_sound_layers_are_mended_at_the_stated_rate():
    rng = np.random.default_rng(7)
    false = 0
    for _ in range(5000):  # every place is tested, each p-value even between 0 and 1
        p = rng.random(300)
        seen = [gap_of(k, 0.0, 0.5, float(p[k])) for k in np.flatnonzero(p < 1e-3)]
        false += bool(confirmed_gaps(seen, 300, None, TEST))
    assert false <= 14  # 5 expected; more than 14 once in 10,000 such tests
