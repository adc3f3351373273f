"""Split a quantity's variance into print to print and scan to scan, with intervals.

One-way random model, y = μ + print + scan, by unweighted means of the prints, which is exact
where every print has as many scans as the others and near enough where not (Thomas & Hultquist
1978, 10.1214/aos/1176344202). The interval of the prints' own standard deviation, scan noise taken
out, is the modified large-sample one of a difference of two mean squares (Ting, Burdick, Graybill,
Jeyaratnam & Lu 1990, J. Stat. Comput. Simul. 35, 135-143).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from kernels.arrays import FloatArray
from registration.comparison.intervals import (
    LEVEL,
    UNKNOWN,
    Interval,
    mean_interval,
    sd_interval,
)


@dataclass(frozen=True)
class Components:
    """Mean and standard deviations of a quantity over prints, in its unit.

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
