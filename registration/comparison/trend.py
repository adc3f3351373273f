"""Fit a linear trend over prints in their order, to test for drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from registration.comparison.intervals import LEVEL, Interval

LEAST = 3
"""Prints that a slope with an interval needs."""


@dataclass(frozen=True)
class Trend:
    """A straight line through prints in their order.

    Attributes
    ----------
    slope : Interval
        Change per unit of what it is drawn over.
    at_first : float
        The line's value at the first print.
    p : float
        Probability of a slope as steep where there is none.
    """

    slope: Interval
    at_first: float
    p: float


def trend(over: Sequence[float], values: Sequence[float]) -> Trend | None:
    """Least squares with Student's t interval (n − 2 degrees of freedom).

    Parameters
    ----------
    over : (n,) float
        Order, or time.
    values : (n,) float
        One a print; NaN are left out.

    Returns
    -------
    Trend or None
        None where fewer than `LEAST` values at different places are known.
    """
    x, y = np.asarray(over, dtype=np.float64), np.asarray(values, dtype=np.float64)
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    if len(x) < LEAST or np.ptp(x) == 0:
        return None
    away, df = x - x.mean(), len(x) - 2
    slope = float(away @ y / (away @ away))
    rest = y - y.mean() - slope * away
    error = float(np.sqrt(rest @ rest / df / (away @ away)))
    half = float(stats.t.ppf(0.5 + LEVEL / 2, df)) * error
    p = _p(slope, error, df)
    start = float(y.mean() + slope * (float(np.asarray(over, dtype=np.float64)[0]) - x.mean()))
    return Trend(Interval(slope, slope - half, slope + half, df), start, p)


def _p(slope: float, error: float, df: int) -> float:
    if error > 0:
        return float(2 * stats.t.sf(abs(slope) / error, df))
    return 1.0 if slope == 0 else 0.0
