"""Fit the lag to a pattern's slow-fast-slow lines; propose the ink profile's `lag` key."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate
from printctl.calibration.lag import Lag, LagPattern, expected_width, fit_lag
from printctl.calibration.patterns import CLEAR, Pattern
from printctl.calibration.widths.result import END, Widths
from printctl.errors import UsageError


def step_lag(pattern: Pattern, widths: Widths) -> tuple[Lag | None, str]:
    """The lag, from lines written slow, fast, slow; or why there is none."""
    steps = pattern.of_role("step")
    if not steps:
        return None, "no line changes its speed, so nothing says the lag (--steps, two speeds)"
    measured = [widths.of(stroke.number) for stroke in steps]
    x, width = (np.concatenate([one[k] for one in measured]) for k in (0, 1))
    slow, fast, _ = steps[0].speed_mm_s.tolist()
    length = steps[0].length_mm / 3
    bead = pattern.bead
    shape = LagPattern(
        slow, fast, length, bead.width_mm, bead.layer_mm, "round" if bead.round_bead else "flat"
    )
    # Thick ink is round at its end, and covers what lies beside it.
    clear = CLEAR * bead.width_mm
    kept = (
        (x <= (2 + END) * length)
        & (np.abs(x - length) >= clear)
        & (np.abs(x - 2 * length) >= clear)
    )
    try:
        lag = fit_lag(x[kept], width[kept], shape, widths.last_digit_mm)
    except UsageError as exc:
        return None, f"no lag from the lines with steps: {exc}"
    return _together(lag, x[kept], width[kept], shape), ""


def _together(lag: Lag, x: FloatArray, width: FloatArray, shape: LagPattern) -> Lag:
    """Widen the intervals where neighbouring places aren't independent, as in a picture.

    A line's roughness is longer than the way between two places. With a correlation ρ from one to
    the next (a first-order autoregression) n places are worth n (1 − ρ)/(1 + ρ).
    """
    rise, fall, factor = lag.rise_s, lag.fall_s, lag.flow_factor
    off = width - expected_width(x, factor.value, rise.value, fall.value, shape)
    follows = np.diff(x) > 0  # the next line begins at 0 again
    rho = float((off[1:] * off[:-1])[follows].sum() / max(float((off**2).sum()), 1e-30))
    wider = math.sqrt((1 + rho) / (1 - rho)) if 0 < rho < 1 else 1.0
    rise, fall, factor = (_widened(one, wider) for one in (rise, fall, factor))
    apart = abs(math.log(rise.value / fall.value))
    half = math.hypot(*(math.log(one.high / one.low) / 2 for one in (rise, fall)))
    return replace(
        lag, rise_s=rise, fall_s=fall, flow_factor=factor, advance_s=rise, linear=apart <= half
    )


def _widened(one: Estimate, times: float) -> Estimate:
    """An interval of a logarithm, widened."""
    low, high = (one.value * (end / one.value) ** times for end in (one.low, one.high))
    return Estimate(one.value, low, high, one.unit)


def lag_notes(lag: Lag) -> list[str]:
    """Say whether one K holds."""
    if lag.linear:
        return ["rise and fall agree: the ink is linear here, and K = τ"]
    return [
        "rise and fall differ: the ink holds pressure by its yield stress, so no single K is "
        "right, and no lag is written"
    ]
