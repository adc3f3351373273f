"""Calibration fits: coverage of the stated intervals on noisy synthetic readings."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, Syringe, load
from printctl.calibration import (
    Estimate,
    LagPattern,
    fit_backlash,
    fit_flow,
    fit_lag,
    fit_level,
    fit_offset,
    fit_weighing,
    gap_between,
)
from printctl.calibration.lag import expected_width
from printctl.errors import UsageError
from tests.slower import examples, first_of

PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
AREA = math.pi / 4 * SYRINGE.inner_mm**2
TRIALS = 200


def covered(trial: Callable[[np.random.Generator], tuple[Estimate, float]]) -> float:
    """How often the interval holds the truth."""
    hits = 0
    for seed in range(TRIALS):
        estimate, truth = trial(np.random.default_rng(seed))
        hits += estimate.holds(truth)
    return hits / TRIALS


def as_promised(share: float) -> bool:
    """95 %, give or take three standard deviations of 200 trials."""
    return abs(share - 0.95) < 3 * math.sqrt(0.95 * 0.05 / TRIALS)


# --- weighing -----------------------------------------------------------------------------------

TRAVEL = np.tile([1.2, 2.4, 3.6], 4)


def test_volume_per_travel_is_covered_as_promised() -> None:
    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        mass = (16.2 * TRAVEL - 0.4) * 0.998 + rng.normal(0, 0.3, len(TRAVEL))
        return fit_weighing(TRAVEL, mass, 0.998).ul_per_mm, 16.2

    assert as_promised(covered(trial))


def test_exact_doses_give_bore_steps_and_loss() -> None:
    found = fit_weighing(TRAVEL, (0.97 * AREA * TRAVEL - 0.5) * 0.998, 0.998)
    assert found.ul_per_mm.value == pytest.approx(0.97 * AREA)
    assert found.lost_ul is not None
    assert found.lost_ul.value == pytest.approx(0.5)
    assert found.bore_mm().value == pytest.approx(SYRINGE.inner_mm * math.sqrt(0.97))
    # With these steps the firmware pushes what the bore promises.
    steps = found.steps_per_mm(PRINTER, SYRINGE).value
    assert steps * 0.97 == pytest.approx(PRINTER.steps_per_mm.e)
    assert found.steps_per_ul(PRINTER).value == pytest.approx(6400 / (0.97 * AREA))


def test_flow_of_an_open_valve_is_covered_as_promised() -> None:
    seconds = np.tile([10.0, 20.0, 30.0], 3)

    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        mass = 0.4 * (seconds - 0.02) * 1.01 + rng.normal(0, 0.05, len(seconds))
        return fit_flow(seconds, mass, 1.01).flow_ul_s, 0.4

    assert as_promised(covered(trial))
    found = fit_flow(seconds, 0.4 * (seconds - 0.25), 1.0)
    assert found.flow_ul_s.value == pytest.approx(0.4)
    assert found.lost_s is not None
    assert found.lost_s.value == pytest.approx(0.25)
    assert fit_flow(np.full(4, 9.0), np.array([3.6, 3.7, 3.5, 3.6]), 1.0).lost_s is None
    with pytest.raises(UsageError, match="open_s and mass_mg"):
        fit_flow(seconds, -seconds, 1.0)


def test_doses_that_are_alike_are_fitted_without_a_loss() -> None:
    rng = np.random.default_rng(3)
    found = fit_weighing(np.full(6, 3.0), 16.7 * 3 + rng.normal(0, 0.2, 6), 1.0)
    assert found.lost_ul is None
    assert found.ul_per_mm.holds(16.7)


def test_an_uncertain_density_widens_the_interval() -> None:
    mass = 16.0 * TRAVEL + np.random.default_rng(0).normal(0, 0.1, len(TRAVEL))
    sure, unsure = fit_weighing(TRAVEL, mass, 1.0), fit_weighing(TRAVEL, mass, 1.0, 0.02)
    assert unsure.ul_per_mm.value == sure.ul_per_mm.value
    assert unsure.ul_per_mm.high - unsure.ul_per_mm.value > 0.02 * 16


@pytest.mark.parametrize(
    ("travel", "mass", "says"),
    [
        ([1, 2], [16, 33], "2 readings for 2 unknowns"),
        ([1, 2, 0], [16, 33, 0], "above 0"),
        ([1, 1.2, 3], [50, 2, 3], "scatter too much"),
    ],
)
def test_weighings_that_say_nothing_are_refused(
    travel: list[float], mass: list[float], says: str
) -> None:
    with pytest.raises(UsageError, match=says):
        fit_weighing(np.array(travel, float), np.array(mass, float), 1.0)


# --- backlash, level, offset --------------------------------------------------------------------

TARGETS = np.repeat(np.arange(0, 25, 5.0), 2)
SIDES = np.tile([1.0, -1.0], 5)


def test_backlash_is_covered_as_promised() -> None:
    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        dial = 3.1 + 1.002 * TARGETS - SIDES * 0.08 / 2 + rng.normal(0, 0.01, len(TARGETS))
        return fit_backlash(TARGETS, SIDES, dial).lost_mm, 0.08

    assert as_promised(covered(trial))


def test_backlash_and_scale_are_told_apart() -> None:
    found = fit_backlash(TARGETS, SIDES, -7 + 0.99 * TARGETS - SIDES * 0.03)
    assert found.lost_mm.value == pytest.approx(0.06)
    assert found.scale.value == pytest.approx(0.99)


def test_readings_from_one_side_tell_no_backlash() -> None:
    with pytest.raises(UsageError, match="don't tell"):
        fit_backlash(np.arange(5.0), np.ones(5), np.arange(5.0))
    with pytest.raises(UsageError, match="approach must be"):
        fit_backlash(np.arange(5.0), np.array([1, 0, 1, -1, 1.0]), np.arange(5.0))


GRID = np.array([(x, y) for x in (0, 40, 80) for y in (0, 40, 80)], dtype=float)


def test_slope_is_covered_as_promised() -> None:
    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        z = 1 + 0.002 * GRID[:, 0] - 0.001 * GRID[:, 1] + rng.normal(0, 0.02, len(GRID))
        return fit_level(GRID[:, 0], GRID[:, 1], z).slope_x, 0.2

    assert as_promised(covered(trial))


def test_plane_and_rise_across_a_part() -> None:
    level = fit_level(GRID[:, 0], GRID[:, 1], 1 + 0.002 * GRID[:, 0] - 0.001 * GRID[:, 1])
    assert level.height_mm.value == pytest.approx(1 + 0.08 - 0.04)
    assert level.slope_y.value == pytest.approx(-0.1)
    assert level.rise_mm(20, 10) == pytest.approx(0.05)


def test_points_on_a_line_make_no_plane() -> None:
    with pytest.raises(UsageError, match="don't tell"):
        fit_level(np.arange(5.0), 2 * np.arange(5.0), np.arange(5.0))


def test_depth_of_the_bath_is_covered_as_promised() -> None:
    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        x, y = GRID.T
        bed = fit_level(x, y, 0.1 + 0.001 * x + rng.normal(0, 0.01, len(x)), (40, 40))
        few = slice(0, 5)
        bath = fit_level(x[few], y[few], 8.14 + rng.normal(0, 0.1, 5), centre_mm=(40, 40))
        return gap_between(bed, bath), 8.0

    assert as_promised(covered(trial))


def test_needle_offset_is_covered_as_promised() -> None:
    truth = np.array([0.31, -0.12, 1.55])

    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        first = rng.normal(0, 0.02, (5, 3)) + (100, 50, 3)
        second = rng.normal(0, 0.05, (4, 3)) + (100, 50, 3) + truth
        axis = int(rng.integers(3))
        return fit_offset(first, second)[axis], float(truth[axis])

    assert abs(covered(trial) - 0.95) < 0.06  # Welch's interval is approximate


def test_touch_offs_that_agree_are_known_to_their_last_digit() -> None:
    same = np.full((3, 3), 3.01)
    x, _, _ = fit_offset(same, same + 0.5, 0.01)
    # Two means of three, each ± 0.01/√12/√3, four degrees of freedom.
    half = 2.7764 * 0.01 / math.sqrt(12) * math.sqrt(2 / 3)
    assert (x.value, x.high - x.value) == pytest.approx((0.5, half), rel=1e-4)
    sure, _, _ = fit_offset(same, same + 0.5)
    assert sure.high - sure.low == pytest.approx(0, abs=1e-12)


def test_a_fit_through_rounded_readings_is_as_wide_as_the_rounding() -> None:
    dial = np.round(3 + 1.0 * TARGETS - SIDES * 0.04, 2)
    found = fit_backlash(TARGETS, SIDES, dial, 0.01)
    assert found.scatter_mm == pytest.approx(0.01 / math.sqrt(12))
    assert found.lost_mm.high - found.lost_mm.low > 0.004
    loud = fit_backlash(TARGETS, SIDES, dial + 0.05 * np.cos(np.arange(10.0) ** 2), 0.01)
    assert loud.scatter_mm > 0.01  # what scatters more isn't touched


@pytest.mark.parametrize("count", [4, 5, 8])
def test_intervals_of_few_readings_are_student_s(count: int) -> None:
    """Slope of a line by the textbook: t(n - 2) s / sqrt(Sxx)."""
    rng = np.random.default_rng(count)
    travel = np.linspace(1.0, 4.0, count)
    volume = 16 * travel - 0.3 + rng.normal(0, 0.1, count)
    found = fit_weighing(travel, volume, 1.0).ul_per_mm
    slope, offset = np.polyfit(travel, volume, 1)
    s = math.sqrt(np.sum((volume - slope * travel - offset) ** 2) / (count - 2))
    t = {4: 4.3027, 5: 3.1824, 8: 2.4469}[count]
    half = t * s / math.sqrt(np.sum((travel - travel.mean()) ** 2))
    assert found.value == pytest.approx(slope)
    assert found.high - found.value == pytest.approx(half, rel=1e-4)


def test_one_touch_off_is_none() -> None:
    with pytest.raises(UsageError, match="at least two"):
        fit_offset(np.zeros((1, 3)), np.zeros((4, 3)))


# --- lag ----------------------------------------------------------------------------------------

PATTERN = LagPattern()
X = np.sort(
    np.concatenate(
        [np.linspace(20, 39.5, 8), np.linspace(40.5, 79.5, 40), np.linspace(80.5, 120, 40)]
    )
)


def widths_by_steps(
    flow_factor: float, rise: float, fall: float, pattern: LagPattern
) -> np.ndarray:
    """The differential equation, in small steps of time."""
    length, area = pattern.length_mm, pattern.area_mm2
    x, flow, dt, found = 0.0, flow_factor * area * pattern.slow_mm_s, 1e-4, []
    grid = X.tolist()
    while grid:
        speed = pattern.fast_mm_s if length <= x < 2 * length else pattern.slow_mm_s
        if x >= grid[0]:
            found.append(flow / (pattern.layer_mm * speed))
            grid.pop(0)
        wanted = flow_factor * area * speed
        flow += (wanted - flow) * dt / (rise if wanted > flow else fall)
        x += speed * dt
    return np.array(found)


def test_expected_widths_are_those_of_the_differential_equation() -> None:
    exact = expected_width(X, 0.9, 0.6, 1.1, PATTERN)
    np.testing.assert_allclose(exact, widths_by_steps(0.9, 0.6, 1.1, PATTERN), rtol=2e-3)


@pytest.mark.parametrize("bead", first_of(["flat", "round"]))
@pytest.mark.parametrize("index", first_of(range(3)))
def test_lag_and_flow_factor_are_covered_as_promised(bead: str, index: int) -> None:
    truth = (0.92, 0.45, 0.7)
    pattern = LagPattern(bead=bead)  # type: ignore[arg-type]
    clean = expected_width(X, *truth, pattern)

    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        lag = fit_lag(X, clean + rng.normal(0, 0.012, len(X)), pattern)
        return (lag.flow_factor, lag.rise_s, lag.fall_s)[index], truth[index]

    assert as_promised(covered(trial))


@given(st.floats(0.7, 1.2), st.floats(0.15, 2.0), st.floats(0.15, 2.0))
@settings(max_examples=examples(30), deadline=None)
def test_exact_widths_give_back_what_made_them(factor: float, rise: float, fall: float) -> None:
    lag = fit_lag(X, expected_width(X, factor, rise, fall, PATTERN), PATTERN)
    assert lag.flow_factor.value == pytest.approx(factor, rel=1e-5)
    assert lag.rise_s.value == pytest.approx(rise, rel=1e-4)
    assert lag.fall_s.value == pytest.approx(fall, rel=1e-4)


def test_an_ink_that_holds_pressure_is_told_from_a_linear_one() -> None:
    noise = np.random.default_rng(5).normal(0, 0.01, len(X))
    assert fit_lag(X, expected_width(X, 1, 0.5, 0.5, PATTERN) + noise, PATTERN).linear
    assert not fit_lag(X, expected_width(X, 1, 0.5, 1.5, PATTERN) + noise, PATTERN).linear


def test_no_lag_is_said_to_be_none() -> None:
    flat = 0.4 + np.random.default_rng(2).normal(0, 0.01, len(X))
    with pytest.raises(UsageError, match="no lag that could be told"):
        fit_lag(X, flat, PATTERN)


def test_a_stretch_without_widths_is_named() -> None:
    with pytest.raises(UsageError, match="third, slow stretch"):
        fit_lag(X[X < 80], np.ones(int((X < 80).sum())), PATTERN)


def test_estimates_are_written_with_the_digits_they_deserve() -> None:
    assert Estimate(16.2345, 16.11, 16.36, "µL/mm").text() == "16.23 (16.11 to 16.36) µL/mm"
    assert Estimate(6400, 6300, 6500, "steps/mm").text() == "6400 (6300 to 6500) steps/mm"
