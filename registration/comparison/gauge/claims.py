"""Compare the budgets' type A uncertainty with the observed scatter of repeated registrations.

Repeats that scatter with variance s2 (df degrees of freedom) about a claim u2 have
df s2/u2 distributed as chi-squared with df, if the claim holds. Of several vessels the mean of
s2/u2 is taken, with Box's degrees of freedom (1954, Ann. Math. Stat. 25, 290-302): vessels of one
scan share part of their errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from kernels.arrays import FloatArray

SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Claim:
    """What budgets claim of repeats, and what was seen.

    Attributes
    ----------
    name : str
        Vessel, scan, or "all vessels".
    claimed_um : float, µm
        Root mean square of the type A standard uncertainties.
    seen_um : float, µm
        Standard deviation of the repeats.
    ratio : float
        Mean over the vessels of seen over claimed variance, which is what `p` is of: where claims
        differ it isn't the ratio of the two means above.
    df : float
    p : float
        Of a ratio as far from 1, in either direction, where the claim holds.
    """

    name: str
    claimed_um: float
    seen_um: float
    ratio: float
    df: float
    p: float

    @property
    def verdict(self) -> str:
        """``agrees``, ``too small`` or ``too large``: the claim; ``unknown`` without one."""
        if not np.isfinite(self.p):
            return "unknown"
        if self.p >= SIGNIFICANT:
            return "agrees"
        return "too small" if self.ratio > 1 else "too large"


def residuals(values: FloatArray, cells: NDArray[np.int64]) -> FloatArray:
    """Return (n, v) values less their cell's mean; a cell with one value gives NaN."""
    rest = np.full(values.shape, np.nan)
    for cell in np.unique(cells):
        rows = cells == cell
        if rows.sum() > 1:
            rest[rows] = values[rows] - values[rows].mean(axis=0)
    return rest


def effective_df(rest: FloatArray, df: float) -> float:
    """Degrees of freedom of a mean of the columns' variances, at least those of one column.

    Box's df (tr S)^2 / tr(S^2), S being the columns' covariance (`residuals`, each column
    standardized by the caller). Few repeats overrate tr(S^2), which makes the number too small,
    and so the intervals too wide.
    """
    known = rest[np.isfinite(rest).all(axis=1)]
    if df < 1 or not known.size:
        return df
    spread = known.T @ known / df
    squares = float((spread**2).sum())
    return max(df, df * float(np.trace(spread)) ** 2 / squares) if squares > 0 else df


def claim(name: str, claimed_um: FloatArray, seen_um: FloatArray, df: float) -> Claim:
    """Compare claims with the scatter seen.

    Parameters
    ----------
    name : str
    claimed_um, seen_um : (v,) float64, µm
        Of each vessel; those where either isn't known, or nothing is claimed, don't count.
    df : float
        Of the mean over the vessels.
    """
    known = np.isfinite(claimed_um) & np.isfinite(seen_um) & (claimed_um > 0)
    if not known.any() or df < 1:
        return Claim(name, np.nan, _rms(seen_um), np.nan, df, np.nan)
    ratio = float(np.mean((seen_um[known] / claimed_um[known]) ** 2))
    tail = stats.chi2.cdf(df * ratio, df)
    p = float(2 * min(tail, stats.chi2.sf(df * ratio, df)))
    return Claim(name, _rms(claimed_um[known]), _rms(seen_um[known]), ratio, df, min(p, 1.0))


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")
