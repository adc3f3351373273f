"""Calibration fits: coverage of the stated intervals on noisy synthetic readings."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

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
from tests.slower import first_of

PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
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


def test_needle_offset_is_covered_as_promised() -> None:
    truth = np.array([0.31, -0.12, 1.55])

    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        first = rng.normal(0, 0.02, (5, 3)) + (100, 50, 3)
        second = rng.normal(0, 0.05, (4, 3)) + (100, 50, 3) + truth
        axis = int(rng.integers(3))
        return fit_offset(first, second)[axis], float(truth[axis])

    assert abs(covered(trial) - 0.95) < 0.06  # Welch's interval is approximate


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


def test_an_ink_that_holds_pressure_is_told_from_a_linear_one() -> None:
    noise = np.random.default_rng(5).normal(0, 0.01, len(X))
    assert fit_lag(X, expected_width(X, 1, 0.5, 0.5, PATTERN) + noise, PATTERN).linear
    assert not fit_lag(X, expected_width(X, 1, 0.5, 1.5, PATTERN) + noise, PATTERN).linear


GRID = np.array([(x, y) for x in (0, 40, 80) for y in (0, 40, 80)], dtype=float)


def test_slope_is_covered_as_promised() -> None:
    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        z = 1 + 0.002 * GRID[:, 0] - 0.001 * GRID[:, 1] + rng.normal(0, 0.02, len(GRID))
        return fit_level(GRID[:, 0], GRID[:, 1], z).slope_x, 0.2

    assert as_promised(covered(trial))


def test_depth_of_the_bath_is_covered_as_promised() -> None:
    def trial(rng: np.random.Generator) -> tuple[Estimate, float]:
        x, y = GRID.T
        bed = fit_level(x, y, 0.1 + 0.001 * x + rng.normal(0, 0.01, len(x)), (40, 40))
        few = slice(0, 5)
        bath = fit_level(x[few], y[few], 8.14 + rng.normal(0, 0.1, 5), centre_mm=(40, 40))
        return gap_between(bed, bath), 8.0

    assert as_promised(covered(trial))
