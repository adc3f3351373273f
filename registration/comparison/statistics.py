"""Statistics over prints: intervals, trend, capability and split of variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from kernels.arrays import FloatArray

LEVEL = 0.95


def rms(values: Sequence[float] | FloatArray) -> float:
    """Return the root mean square of the finite values, NaN if there are none."""
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")


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


@dataclass(frozen=True)
class Capability:
    """Of one quantity against ± a tolerance about zero.

    Cp = (upper − lower)/6s, Cpk = min(upper − mean, mean − lower)/3s (ISO 22514-2). Both rest on a
    normal process in control, which a handful of prints can't show; their intervals say how little
    a handful tells. Cp: chi-squared; Cpk: Bissell 1990 (Applied Statistics 39, 331-340).
    """

    cp: Interval
    cpk: Interval


def capability(mean: float, sd: Interval, limit: float) -> Capability:
    """Capability of a quantity that should be zero and may be ± `limit`.

    Parameters
    ----------
    mean : float
    sd : Interval
        Over prints, as observed, in the unit of `mean`.
    limit : float
        Half the width of the tolerance, in the same unit.
    """
    if sd.df < 1 or sd.value == 0:
        return Capability(UNKNOWN, UNKNOWN)
    cp = limit / (3 * sd.value)
    low, high = sd_factors(sd.df)
    cpk = (limit - abs(mean)) / (3 * sd.value)
    normal = float(stats.norm.ppf(0.5 + LEVEL / 2))
    half = normal * float(np.sqrt(1 / (9 * (sd.df + 1)) + cpk**2 / (2 * sd.df)))
    return Capability(
        Interval(cp, cp / high, cp / low, sd.df), Interval(cpk, cpk - half, cpk + half, sd.df)
    )


@dataclass(frozen=True)
class Components:
    """Mean and standard deviations of a quantity over prints, in its unit.

    One-way random model, y = μ + print + scan, by unweighted means of the prints, which is exact
    where every print has as many scans as the others and near enough where not (Thomas & Hultquist
    1978, 10.1214/aos/1176344202). The interval of the prints' own standard deviation, scan noise
    taken out, is the modified large-sample one of a difference of two mean squares (Ting, Burdick,
    Graybill, Jeyaratnam & Lu 1990, J. Stat. Comput. Simul. 35, 135-143).

    Attributes
    ----------
    prints, scans : int
        That have a value.
    mean : Interval
        Of the prints' means, each print counting once.
    observed_sd : Interval
        Of the prints' means as they were measured: scan noise is in it.
    scan_sd : Interval
        Between scans of one print (repeatability); unknown where no print has two.
    print_sd : Interval
        From print to print with scan noise taken out; unknown where that is.
    print_means : tuple of float
        By print in the order given; NaN where a print has no value.
    """

    prints: int
    scans: int
    mean: Interval
    observed_sd: Interval
    scan_sd: Interval
    print_sd: Interval
    print_means: tuple[float, ...]


def components(values: FloatArray, prints: Sequence[int]) -> Components:
    """Take a quantity apart into what its prints and its scans contribute.

    Parameters
    ----------
    values : (n,) float64
        One a scan; NaN where it wasn't measured.
    prints : (n,) int
        The print that each is a scan of, counted from 0.
    """
    of, count = np.asarray(prints), max(prints) + 1
    groups = [values[(of == k) & np.isfinite(values)] for k in range(count)]
    means = np.array([group.mean() if len(group) else np.nan for group in groups])
    known = [group for group in groups if len(group)]
    seen = means[np.isfinite(means)]
    df = len(known) - 1
    observed = sd_interval(float(seen.std(ddof=1)), df) if df >= 1 else UNKNOWN
    scan = _scan_sd(known)
    return Components(
        prints=len(known),
        scans=sum(len(group) for group in known),
        mean=mean_interval(seen),
        observed_sd=observed,
        scan_sd=scan,
        print_sd=prints_sd(observed, scan, _mean_scans(known)),
        print_means=tuple(means.tolist()),
    )


def _scan_sd(groups: list[FloatArray]) -> Interval:
    df = sum(len(group) - 1 for group in groups)
    if df < 1:
        return UNKNOWN
    squares = sum(float(((group - group.mean()) ** 2).sum()) for group in groups)
    return sd_interval(float(np.sqrt(squares / df)), df)


def _mean_scans(groups: list[FloatArray]) -> float:
    """Harmonic mean of the scans of a print."""
    return len(groups) / max(sum(1 / len(group) for group in groups), 1e-9)


def prints_sd(observed: Interval, scan: Interval, scans: float) -> Interval:
    """The prints' own standard deviation; never below zero.

    Parameters
    ----------
    observed, scan : Interval
        Of the prints' means as measured, and between scans of one print.
    scans : float
        Harmonic mean of the scans of a print.
    """
    if observed.df < 1 or scan.df < 1:
        return UNKNOWN
    between, within = scans * observed.value**2, scan.value**2
    low, high = difference_interval(between, observed.df, within, scan.df)
    value, low, high = (
        float(np.sqrt(max(square, 0.0) / scans)) for square in (between - within, low, high)
    )
    return Interval(value, low, high, observed.df)


def difference_interval(
    first: float, first_df: float, second: float, second_df: float
) -> tuple[float, float]:
    """95 % interval of the difference of two expected mean squares, estimated with their df."""
    tail = (1 - LEVEL) / 2
    top, bottom = 1 - tail, tail
    reach = []
    for side, other in ((top, bottom), (bottom, top)):
        g = abs(1 - first_df / stats.chi2.ppf(side, first_df))
        h = abs(second_df / stats.chi2.ppf(other, second_df) - 1)
        f = stats.f.ppf(side, first_df, second_df)
        mixed = ((f - 1) ** 2 - g**2 * f**2 - h**2) / f
        squares = g**2 * first**2 + h**2 * second**2 + mixed * first * second
        reach.append(float(np.sqrt(max(squares, 0.0))))
    return first - second - reach[0], first - second + reach[1]
