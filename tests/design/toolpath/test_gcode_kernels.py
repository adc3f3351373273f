"""G-code text, digits and merging of moves, against slow oracles."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.gcode.merge import long_enough
from design.toolpath.gcode.numbers import decimals_for
from design.toolpath.gcode.table import Table, render
from firmware_profiles import Printer, load
from tests.slower import examples

DECIMALS = (3, 3, 4, 5, 3, 0)


@settings(max_examples=examples(200))
@given(st.lists(st.integers(-(10**12), 10**12), min_size=6, max_size=6), st.integers(0, 63))
def test_text_is_the_exact_value_without_idle_digits(values, mask):
    given_words = np.array([[bool(mask >> k & 1) for k in range(6)]])
    none = np.array([-1])
    table = Table(np.array([1]), np.array([values]), given_words, none, none)
    text, longest = render(table, DECIMALS)
    assert longest == len(text) - 1
    words = text.decode().rstrip("\n").split(" ")
    assert words[0] == "G1"
    expected = {
        letter: Fraction(value, 10**digits)
        for letter, value, digits, there in zip(
            "XYZEFP", values, DECIMALS, given_words[0], strict=True
        )
        if there
    }
    assert {word[0]: Fraction(word[1:]) for word in words[1:]} == expected
    for word in words[1:]:
        assert not ("." in word and word[-1] in "0.")
        assert not word[1:].startswith(("00", "-00", ".", "-."))


def test_many_rows_keep_their_order():
    count = 150_000
    value = np.zeros((count, 6), dtype=np.int64)
    value[:, 0] = np.arange(count)
    given_words = np.zeros((count, 6), dtype=bool)
    given_words[:, 0] = True
    code = np.ones(count, dtype=np.int64)
    text, _ = render(Table(code, value, given_words, code, code), (0, 0, 0, 0, 0, 0))
    assert text == b"".join(b"G1 X%d\n" % k for k in range(count))


@pytest.mark.parametrize("name", ["generic_marlin", "marlin_avr"])
def test_last_digit_is_finer_than_a_quarter_of_a_step(name):
    printer = load(Printer, name)
    digits = decimals_for(printer)
    for axis in "xyze":
        assert 10.0 ** -getattr(digits, axis) < 0.25 / getattr(printer.steps_per_mm, axis)
    assert digits.x >= 3


paths = st.lists(st.tuples(st.integers(-8, 8), st.integers(-8, 8)), min_size=1, max_size=60)


@given(paths, st.integers(0, 5))
def test_merged_runs_have_no_short_move_but_keep_their_ends(moves, cut):
    position = np.zeros((len(moves) + 1, 4))
    position[1:, :2] = np.cumsum(np.array(moves, float), axis=0)
    run = np.arange(len(moves)) // (10 * (cut + 1))
    keep = long_enough(position, run, 6.0)
    for number in np.unique(run):
        members = np.flatnonzero(run == number)
        assert keep[members[-1]]
        vertices = np.concatenate([[members[0]], members[keep[members]] + 1])
        if len(vertices) > 2:
            steps = np.abs(np.diff(position[vertices], axis=0)).max(axis=1)
            assert (steps[:-1] >= 6).all()


def test_moves_outside_runs_stay():
    position = np.zeros((6, 4))
    assert long_enough(position, np.full(5, -1), 6.0).all()


def test_the_corner_stays_and_the_point_beside_it_goes():
    # Two long stretches that meet at (100, 0), with a short move just after the corner.
    xy = np.array([[0, 0], [100, 0], [100, 2], [100, 100]], dtype=float)
    position = np.hstack([xy, np.zeros((4, 2))])
    assert long_enough(position, np.zeros(3, dtype=np.int64), 6.0).tolist() == [True, False, True]
    # And just before it.
    xy[1] = [98, 0]
    xy[2] = [100, 0]
    position = np.hstack([xy, np.zeros((4, 2))])
    assert long_enough(position, np.zeros(3, dtype=np.int64), 6.0).tolist() == [False, True, True]
