"""Fit flow factor, drift and starting lag of a spiral printed without a stop.

Cross-section over the commanded one, t seconds after the begin:

    G (1 + k t) (1 − c e^(−t/τ))

with G = f s², k the drift, c what is missing at the begin: the prime fills some of it, so c is
free.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from kernels.arrays import FloatArray
from printctl.calibration.estimate import Estimate, fit_line, quantile
from printctl.calibration.patterns import WrittenPattern
from printctl.calibration.widths.factors import GivenValues, factors
from printctl.calibration.widths.lines import shares_along
from printctl.calibration.widths.result import Answer, Widths
from printctl.errors import UsageError

_FEWEST: Final = 8
_BLOB: Final = 3.0
"""Widths from its begin in which a line has a shape of its own: the tip starts to move."""
_STARTS: Final = (0.1, 0.5, 2.0)
_UNRESOLVED: Final = 3.0
_LAGS: Final = 5.0


def fit_spiral(written: WrittenPattern, widths: Widths, known: GivenValues) -> Answer:
    """Fit flow factor, drift and, where its begin is thin, the lag.

    Raises
    ------
    UsageError
        With too few widths.
    """
    pattern = written.pattern
    (stroke,) = pattern.of_role("spiral")
    time, share = shares_along(pattern, stroke, widths)
    if len(time) < _FEWEST:
        raise UsageError(f"{len(time)} widths along the spiral; measure {_FEWEST} or more")
    blob = _BLOB * pattern.bead.width_mm / float(stroke.speed_mm_s[0])
    tau, notes = _begin(time[time > blob], share[time > blob])
    settled = time >= (0.1 * time[-1] if tau is None else _LAGS * tau.value)
    if settled.sum() < _FEWEST:
        raise UsageError("the spiral's flow hasn't settled before it ends; print more turns")
    late, area = time[settled], share[settled]
    middle = float(late.mean())
    digit = 2 * widths.last_digit_mm / pattern.bead.width_mm * float(np.median(area))
    fit = fit_line(np.column_stack([np.ones(len(late)), late - middle]), area, "spiral", digit)
    level, slope = fit.estimate(0, ""), fit.estimate(1, "")
    half = math.hypot((level.high - level.low) / 2, 2 * widths.optics * level.value)
    total = Estimate(level.value, level.value - half, level.value + half)
    drift = slope.times(60 * 100 / level.value, "% a minute")
    factor_estimates, changes, more = factors(total, written, known)
    estimates = {"cross-section over the commanded one": total, **factor_estimates, "drift": drift}
    if tau is not None:
        estimates["τ, from its begin"] = tau
    if not drift.holds(0.0):
        notes.append("the flow drifts: warmth, a syringe that gives way, ink that settles or sets")
    return Answer(estimates, (), [*more, *notes], changes)


def _begin(time: FloatArray, share: FloatArray) -> tuple[Estimate | None, list[str]]:
    """τ from the line's thin begin; None where it isn't thin enough to tell."""
    if len(time) < _FEWEST:
        return None, [_UNTOLD]

    def model(p: FloatArray) -> FloatArray:
        return np.asarray(p[0] * (1 + p[1] * time) * (1 - p[2] * np.exp(-time / np.exp(p[3]))))

    level = float(np.median(share))
    tries = [
        least_squares(
            lambda p: model(p) - share,
            [level, 0.0, 0.5, math.log(start)],
            bounds=([0, -1, -2, math.log(1e-3)], [10 * level, 1, 1, math.log(max(time[-1], 1))]),
            x_scale=[level, 0.01, 0.5, 1.0],
        )
        for start in _STARTS
    ]
    best = min(tries, key=lambda one: float(one.cost))
    dof = len(time) - 4
    try:
        inverse = np.linalg.inv(best.jac.T @ best.jac)
    except np.linalg.LinAlgError:
        return None, [_UNTOLD]
    half = quantile(dof) * np.sqrt(np.maximum(np.diag(inverse), 0) * 2 * best.cost / dof)
    missing, log_tau = float(best.x[2]), float(best.x[3])
    if not np.isfinite(half).all() or missing <= half[2] or half[3] > math.log(_UNRESOLVED):
        return None, [_UNTOLD]
    value, low, high = (math.exp(log_tau + side * half[3]) for side in (0, -1, 1))
    note = (
        f"the spiral begins with {missing:.0%} of its flow missing; the lag of a begin takes the "
        "prime's place with it, so it isn't written (lines with --steps give one that is)"
    )
    return Estimate(value, low, high, "s"), [note]


_UNTOLD: Final = (
    "the spiral's begin isn't thin enough to tell a lag: the prime fills it, or it is shorter than "
    "the places lie apart"
)
