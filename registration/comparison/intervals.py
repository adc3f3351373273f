"""95 % intervals of means and standard deviations; p-values of means, with Holm's correction.

Normal theory throughout (Box, Hunter & Hunter 2005, chapter 2): with few prints it is all there
is, and its intervals are as wide as the few prints deserve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from kernels.arrays import FloatArray

LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval and the degrees of freedom that it rests on.

    Attributes
    ----------
    value, low, high : float
        In the unit of what was estimated; NaN what can't be known.
    df : float
    """

    value: float
    low: float
    high: float
    df: float


UNKNOWN = Interval(np.nan, np.nan, np.nan, 0)


def mean_interval(values: FloatArray) -> Interval:
    """Mean of independent values (n,) with Student's t interval; no interval from one."""
    n = len(values)
    if n == 0:
        return UNKNOWN
    mean = float(values.mean())
    if n < 2:
        return Interval(mean, np.nan, np.nan, 0)
    half = float(stats.t.ppf(0.5 + LEVEL / 2, n - 1) * values.std(ddof=1) / np.sqrt(n))
    return Interval(mean, mean - half, mean + half, n - 1)


def sd_interval(sd: float, df: float) -> Interval:
    """A standard deviation with its interval: df · s²/σ² is chi-squared with `df`."""
    if df < 1 or not np.isfinite(sd):
        return UNKNOWN
    low, high = sd_factors(df)
    return Interval(sd, low * sd, high * sd, df)


def sd_factors(df: float) -> tuple[float, float]:
    """What the interval's ends of a standard deviation are, as multiples of it."""
    tail = (1 - LEVEL) / 2
    return (
        float(np.sqrt(df / stats.chi2.ppf(1 - tail, df))),
        float(np.sqrt(df / stats.chi2.ppf(tail, df))),
    )


def mean_p(values: FloatArray) -> float:
    """Probability of a mean as far from zero as that of (n,) values whose true mean is zero."""
    if len(values) < 2:
        return float("nan")
    error = values.std(ddof=1) / np.sqrt(len(values))
    if error == 0:
        return 1.0 if values.mean() == 0 else 0.0
    return float(2 * stats.t.sf(abs(values.mean()) / error, len(values) - 1))


def holm(p: Sequence[float]) -> FloatArray:
    """Probabilities after Holm's correction for their number (1979); NaN stay and don't count.

    Below 0.05 is what stands out at that level among all of them together.
    """
    chances = np.asarray(p, dtype=np.float64)
    adjusted = np.full(len(chances), np.nan)
    known = np.flatnonzero(np.isfinite(chances))
    order = known[np.argsort(chances[known], kind="stable")]
    steps = chances[order] * (len(order) - np.arange(len(order)))
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted
