"""G-code text, digits and merging of moves, against slow oracles."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from design.toolpath.gcode.render import Table, render
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


paths = st.lists(st.tuples(st.integers(-8, 8), st.integers(-8, 8)), min_size=1, max_size=60)
