import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printctl.checks.gcode_view.widths import cross_sections
from printctl.rounding import window_mm


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


def test_the_window_tells_a_rounded_dose_to_two_percent():
    rng = np.random.default_rng(3)
    area, digit = 0.009, 1.7e-4
    window = window_mm(digit, area)
    ends = rng.uniform(0, 1, 20_000)
    # Lengths about the window's, so that the two ends are rounded independently.
    way = window * rng.uniform(0.9, 1.1, 20_000)
    pushed = np.rint((ends + way * area) / digit) - np.rint(ends / digit)
    assert np.std(pushed * digit / way / area) == pytest.approx(0.02, rel=0.1)
