"""Run a gauge study (operators x parts x repeats), and check budgets against scatter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from kernels.arrays import FloatArray, IntArray
from registration.comparison.gauge_shares import (
    MeanSquares,
    Shares,
    mean_squares,
    pooled_squares,
    shares,
)
from registration.comparison.scans import GaugedScan, GaugeStudyError
from registration.comparison.statistics import rms

# Compare the budgets' type A uncertainty with the observed scatter of repeated registrations.
#
# Repeats that scatter with variance s2 (df degrees of freedom) about a claim u2 have
# df s2/u2 distributed as chi-squared with df, if the claim holds. Of several vessels the mean of
# s2/u2 is taken, with Box's degrees of freedom (1954, Ann. Math. Stat. 25, 290-302): vessels of one
# scan share part of their errors.
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
        return Claim(name, np.nan, rms(seen_um), np.nan, df, np.nan)
    ratio = float(np.mean((seen_um[known] / claimed_um[known]) ** 2))
    tail = stats.chi2.cdf(df * ratio, df)
    p = float(2 * min(tail, stats.chi2.sf(df * ratio, df)))
    return Claim(name, rms(claimed_um[known]), rms(seen_um[known]), ratio, df, min(p, 1.0))


@dataclass(frozen=True)
class GaugeQuantity:
    """A quantity of the study.

    Attributes
    ----------
    name : str
        ``diameters`` and ``vessel_offsets`` (all vessels pooled), ``offset``, ``diameter_3``,
        ``offset_3``.
    vessel : int or None
    squares : MeanSquares, in µm²
    shares : Shares, in µm
    width_um : float, µm
        Of the tolerance; NaN: none.
    """

    name: str
    vessel: int | None
    squares: MeanSquares
    shares: Shares
    width_um: float


@dataclass(frozen=True)
class GaugeStudy:
    """Result of a gauge study.

    Attributes
    ----------
    operators, parts : tuple of str
    operator_of, part_of : tuple of int
        Of each scan, in the comparison's order.
    labels : tuple of str
        Of the scans.
    repeats : tuple of tuple of int
        Scans of each part (inner) by each operator (outer).
    quantities : tuple of GaugeQuantity
        Pooled ones first.
    left_out : tuple of (str, str)
        Quantities that the study doesn't tell, and why.
    claims : tuple of Claim
        All vessels together, then each vessel's, then each scan's against all repeats.
    """

    operators: tuple[str, ...]
    parts: tuple[str, ...]
    operator_of: tuple[int, ...]
    part_of: tuple[int, ...]
    labels: tuple[str, ...]
    repeats: tuple[tuple[int, ...], ...]
    quantities: tuple[GaugeQuantity, ...]
    left_out: tuple[tuple[str, str], ...]
    claims: tuple[Claim, ...]

    @property
    def balanced(self) -> bool:
        """Whether every operator measured every part equally often."""
        return len({count for row in self.repeats for count in row}) == 1

    def quantity(self, name: str) -> GaugeQuantity | None:
        """Return the quantity of that name, None where it was left out."""
        return next((q for q in self.quantities if q.name == name), None)


def gauge_study(
    scans: Sequence[GaugedScan], operators: Sequence[str], parts: Sequence[str]
) -> GaugeStudy:
    """Analyse registrations as a crossed study.

    Parameters
    ----------
    scans : sequence of GaugedScan
        Of one design.
    operators, parts : sequence of str
        Of each scan.

    Raises
    ------
    GaugeStudyError
        When an operator didn't measure a part, or nothing was measured twice.
    """
    people, who = _numbered(operators)
    things, what = _numbered(parts)
    repeats = _check_crossed(people, things, who, what)
    cells = who * len(things) + what
    diameter = np.array([scan.measured_um for scan in scans])
    width = _median([scan.width_um for scan in scans])
    none = np.full(len(width), np.nan)
    left_out: list[tuple[str, str]] = []
    quantities: list[GaugeQuantity] = []
    for name, values, widths in (
        ("diameter", diameter, width),
        ("offset", np.array([scan.offsets_um for scan in scans]), none),
    ):
        each = _each(name, values, (who, what), widths, left_out)
        pooled = _pooled(each, values, cells, widths)
        quantities = [*([pooled] if pooled else []), *quantities, *each]
    radial = np.array([[scan.offset_um] for scan in scans])
    quantities += _each("radial_offset", radial, (who, what), none[:1], left_out)
    order = {"diameters": 0, "offsets": 1, "radial_offset": 2}
    return GaugeStudy(
        operators=people,
        parts=things,
        operator_of=tuple(who.tolist()),
        part_of=tuple(what.tolist()),
        labels=tuple(scan.label for scan in scans),
        repeats=repeats,
        quantities=tuple(sorted(quantities, key=lambda q: order.get(q.name, 3))),
        left_out=tuple(left_out),
        claims=_claims(scans, diameter, cells),
    )


def _numbered(names: Sequence[str]) -> tuple[tuple[str, ...], IntArray]:
    known = tuple(dict.fromkeys(names))
    return known, np.array([known.index(name) for name in names])


def _check_crossed(
    people: tuple[str, ...], things: tuple[str, ...], who: IntArray, what: IntArray
) -> tuple[tuple[int, ...], ...]:
    """Return the scans of each cell; refuse a study that isn't crossed or has no repeats."""
    count = np.zeros((len(people), len(things)), dtype=int)
    np.add.at(count, (who, what), 1)
    missing = [
        f"{people[i]} has no scan of part {things[j]}" for i, j in np.argwhere(count == 0)[:4]
    ]
    if missing:
        raise GaugeStudyError(
            f"this is no crossed study: {'; '.join(missing)}; let every operator scan every part, "
            "or leave those folders out"
        )
    if count.max() == 1 and min(count.shape) == 1:
        raise GaugeStudyError(
            f"no part was scanned twice ({len(who)} scans, {len(things)} parts, {len(people)} "
            "operators); scan each part at least twice, or say with --operators and --parts what "
            "the folders are"
        )
    return tuple(tuple(int(n) for n in row) for row in count)


def _median(rows: Sequence[FloatArray]) -> FloatArray:
    """Median of each column's known values; NaN where none is."""
    table = np.array(rows)
    return np.array([np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else np.nan
                     for c in table.T])  # fmt: skip


def _each(
    name: str,
    values: FloatArray,
    design: tuple[IntArray, IntArray],
    widths: FloatArray,
    left_out: list[tuple[str, str]],
) -> list[GaugeQuantity]:
    """Every column of (n, v) `values`; what can't be told goes to `left_out`."""
    quantities = []
    for v in range(values.shape[1]):
        alone = name == "radial_offset"
        whole = name if alone else f"{name}_{v}"
        try:
            squares = mean_squares(values[:, v], *(list(map(int, each)) for each in design))
        except GaugeStudyError as exc:
            left_out.append((whole, str(exc)))
            continue
        made = shares(squares, float(widths[v]))
        quantities.append(
            GaugeQuantity(whole, None if alone else v, squares, made, float(widths[v]))
        )
    return quantities


def _pooled(
    each: Sequence[GaugeQuantity], values: FloatArray, cells: IntArray, widths: FloatArray
) -> GaugeQuantity | None:
    """All vessels that every scan measured, together."""
    complete = np.atleast_1d(np.isfinite(values).all(axis=0))
    whole = [q for q in each if q.vessel is not None and complete[q.vessel]]
    if not whole:
        return None
    at = np.array([q.vessel for q in whole], dtype=np.int64)
    rest = residuals(values[:, at], cells)
    squares = pooled_squares(
        [q.squares for q in whole], effective_df(rest, whole[0].squares.error.df)
    )
    known = widths[at][np.isfinite(widths[at])]
    width = float(np.median(known)) if len(known) else float("nan")
    name = f"{whole[0].name.rpartition('_')[0]}s"
    return GaugeQuantity(name, None, squares, shares(squares, width), width)


def _claims(
    scans: Sequence[GaugedScan], diameter: FloatArray, cells: IntArray
) -> tuple[Claim, ...]:
    """Each vessel's and each scan's type A share against the repeats."""
    rest = residuals(diameter, cells)
    known = np.isfinite(diameter).all(axis=0)
    df = float(len(scans) - len(np.unique(cells)))
    if df < 1 or not known.any():
        return ()
    seen = np.where(known, np.sqrt(np.nansum(rest**2, axis=0) / df), np.nan)
    type_a_um = np.array([scan.type_a_um for scan in scans])
    every = np.sqrt((type_a_um**2).mean(axis=0))
    usable = known & np.isfinite(every) & (every > 0)
    own = rest[:, usable] / every[usable] if usable.any() else rest[:, :0]
    shared = effective_df(own, df)
    return (
        claim("all vessels", every, seen, shared),
        *(claim(f"vessel {v}", every[[v]], seen[[v]], df) for v in np.flatnonzero(usable)),
        *(claim(f"scan {scan.label}", scan.type_a_um, seen, shared) for scan in scans),
    )
