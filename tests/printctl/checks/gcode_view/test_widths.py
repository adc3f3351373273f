import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles.bead import BeadSection
from printctl.checks.gcode_view.read import cross_sections, widths
from printctl.rounding import last_digit_mm, window_mm


def slow_cross_section(way, dose, runs, window, i):
    """Mean over the window about the middle of piece i, by walking the run in small steps."""
    inside = [k for k in range(len(way)) if runs[k] == runs[i]]
    at = {k: sum(way[j] for j in inside if j < k) for k in inside}
    middle, half = at[i] + way[i] / 2, max(way[i], window) / 2
    low, high = max(middle - half, 0.0), min(middle + half, sum(way[j] for j in inside))
    total = 0.0
    for k in inside:
        shared = min(high, at[k] + way[k]) - max(low, at[k])
        total += max(shared, 0.0) * dose[k] / way[k]
    return total / (high - low)


@given(
    st.lists(
        st.tuples(st.floats(0.01, 3), st.floats(0.001, 1), st.booleans()), min_size=1, max_size=25
    ),
    st.floats(0, 2),
)
def test_cross_sections_are_means_over_a_window_that_ends_with_the_run(pieces, window):
    way, dose, begins = (np.array(column) for column in zip(*pieces, strict=True))
    begins = begins.astype(bool)
    begins[0] = True
    found = cross_sections(way, dose, begins, window)
    runs = np.cumsum(begins)
    slow = [slow_cross_section(way, dose, runs, window, i) for i in range(len(way))]
    assert found == pytest.approx(slow, rel=1e-6)


def test_without_a_window_each_piece_has_its_own_dose():
    way, dose = np.array([1.0, 2.0, 4.0]), np.array([0.5, 0.5, 4.0])
    begins = np.array([True, False, False])
    assert cross_sections(way, dose, begins, 0.0).tolist() == [0.5, 0.25, 1.0]


def test_width_of_a_straight_a_stadium_shaped_and_a_round_line():
    height, width = 0.06, 0.15
    straight = widths(np.array([width * height]), np.array([height]), BeadSection("rectangle"))
    stadium = (width - height) * height + math.pi * height**2 / 4
    sides = widths(np.array([stadium]), np.array([height]), BeadSection())
    thread = widths(np.array([math.pi * 0.2**2 / 4]), np.array([np.nan]), BeadSection())
    thin = widths(np.array([math.pi * 0.03**2 / 4]), np.array([height]), BeadSection())
    assert straight == pytest.approx([0.15])
    assert sides == pytest.approx([0.15])
    assert thread == pytest.approx([0.2])
    assert thin == pytest.approx([0.03])


@pytest.mark.parametrize("digits", [1, 2, 3, 4, 5])
def test_the_last_digit_of_e_is_found(digits):
    numbers = np.random.default_rng(1).uniform(0, 100, 500)
    assert last_digit_mm(np.round(numbers, digits)) == pytest.approx(10.0**-digits)


def test_the_window_tells_a_rounded_dose_to_two_percent():
    rng = np.random.default_rng(3)
    area, digit = 0.009, 1.7e-4
    window = window_mm(digit, area)
    ends = rng.uniform(0, 1, 20_000)
    # Lengths about the window's, so that the two ends are rounded independently.
    way = window * rng.uniform(0.9, 1.1, 20_000)
    pushed = np.rint((ends + way * area) / digit) - np.rint(ends / digit)
    assert np.std(pushed * digit / way / area) == pytest.approx(0.02, rel=0.1)
