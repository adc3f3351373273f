"""Run a gauge study of registrations: operators x parts x repeats, for every quantity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray, IntArray
from registration.comparison.errors import GaugeStudyError
from registration.comparison.gauge.claims import Claim, claim, effective_df, residuals
from registration.comparison.gauge.shares import Shares, shares
from registration.comparison.gauge.squares import MeanSquares, mean_squares, pooled_squares
from registration.comparison.scans import GaugedScan


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
