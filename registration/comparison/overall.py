"""Statistics over several prints: diameter error, scale, offset, deviation, repeatability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kernels.arrays import FloatArray
from registration.comparison.scans import AXES, GaugedScan
from registration.comparison.statistics import (
    UNKNOWN,
    Components,
    Interval,
    Trend,
    components,
    holm,
    prints_sd,
    rms,
    sd_interval,
    trend,
)
from registration.comparison.vessels import VesselSpread

DAY_S = 86400.0


@dataclass(frozen=True)
class Quantity:
    """One number of each scan, over the prints.

    Attributes
    ----------
    name, unit : str
        As in compare.json; the unit of `parts`.
    values, half : tuple of float
        By scan: the value and half of its own 95 % interval; NaN what isn't known.
    parts : Components
    per_print, per_day : Trend or None
        Over the prints' order; over their time where it is known and spans a day.
    p_drift : float
        Of `per_print`, after Holm's correction for all quantities that have one.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    half: tuple[float, ...]
    parts: Components
    per_print: Trend | None
    per_day: Trend | None
    p_drift: float = float("nan")


@dataclass(frozen=True)
class Repeatability:
    """Any vessel's diameter, µm: spreads pooled over all vessels.

    The vessels of one print share its scale, and those of one scan its segmentation: the
    intervals take the prints' (the scans') degrees of freedom, not the vessels'.

    Attributes
    ----------
    vessels : int
        That take part: measured in every scan.
    observed_sd : Interval
        From print to print, scan noise in it.
    scan_sd, print_sd : Interval
        Repeatability of the scan; the prints' own. Unknown where no print was scanned twice.
    along_sd_um : float
        Within a print, along its vessels.
    gauge_percent : float
        Scan noise over the total spread of single scans, in per cent of standard deviations
        (the %GRR of a gauge study; reproducibility by other scanners and people isn't in it).
    distinct : int or None
        How many kinds of prints such a gauge tells apart: 1.41 · print / scan (ndc).
    """

    vessels: int
    observed_sd: Interval
    scan_sd: Interval
    print_sd: Interval
    along_sd_um: float
    gauge_percent: float
    distinct: int | None


def quantities(
    scans: Sequence[GaugedScan], prints: Sequence[int], days: Sequence[float] | None
) -> tuple[Quantity, ...]:
    """Mean diameter error, scales, offset and deviation over the prints.

    Parameters
    ----------
    scans, prints : sequences
        See `vessel_spreads`.
    days : sequence of float or None
        Of each print since the first; None where not all are known.
    """
    none = np.full(len(scans), np.nan)
    error = np.array([scan.error_um for scan in scans])
    everywhere = np.isfinite(error).all(axis=0)
    mean = error[:, everywhere].mean(axis=1) if everywhere.any() else none
    scale = 100 * (np.array([scan.scale for scan in scans]) - 1)
    scale_half = 100 * np.array([scan.scale_half for scan in scans])
    # An axis whose scale wasn't fitted has one by decree, which is no measurement.
    fitted = np.where(np.isfinite(scale_half), scale, np.nan)
    rows: list[tuple[str, str, FloatArray, FloatArray]] = [
        ("mean_diameter_error", "µm", mean, none),
        *((f"scale_{axis}", "%", fitted[:, k], scale_half[:, k]) for k, axis in enumerate(AXES)),
        (
            "offset",
            "µm",
            np.array([scan.offset_um for scan in scans]),
            np.array([scan.offset_half_um for scan in scans]),
        ),
        ("rms_deviation", "µm", np.array([scan.rms_um for scan in scans]), none),
    ]
    made = [_quantity(name, unit, values, half, prints, days) for name, unit, values, half in rows]
    corrected = holm([np.nan if q.per_print is None else q.per_print.p for q in made])
    return tuple(replace(q, p_drift=float(p)) for q, p in zip(made, corrected, strict=True))


def _quantity(
    name: str,
    unit: str,
    values: FloatArray,
    half: FloatArray,
    prints: Sequence[int],
    days: Sequence[float] | None,
) -> Quantity:
    parts = components(values, prints)
    means = parts.print_means
    long_enough = days is not None and max(days) - min(days) >= 1
    return Quantity(
        name=name,
        unit=unit,
        values=tuple(values.tolist()),
        half=tuple(half.tolist()),
        parts=parts,
        per_print=trend(range(len(means)), means),
        per_day=trend(days, means) if days is not None and long_enough else None,
    )


def repeatability(vessels: Sequence[VesselSpread], prints: Sequence[int]) -> Repeatability:
    """Pool the vessels' spreads.

    Squares are pooled before scan noise is taken out of them: spreads that were cut off at 0 one by
    one would never come out as 0 together.
    """
    whole = [v for v in vessels if v.error.scans == len(prints)]
    observed, scan = (
        _pooled([getattr(v.error, name) for v in whole]) for name in ("observed_sd", "scan_sd")
    )
    count = np.bincount(prints)
    own = prints_sd(observed, scan, len(count) / float((1 / count).sum()))
    total = np.hypot(own.value, scan.value)
    return Repeatability(
        vessels=len(whole),
        observed_sd=observed,
        scan_sd=scan,
        print_sd=own,
        along_sd_um=rms([v.along_sd_um for v in vessels]),
        gauge_percent=float(100 * scan.value / total) if total > 0 else float("nan"),
        distinct=_distinct(own.value, scan.value),
    )


def _distinct(own: float, scan: float) -> int | None:
    """Kinds of prints that scans tell apart; None where either spread isn't known, or no noise."""
    return int(1.41 * own / scan) if np.isfinite(own) and scan > 0 else None


def _pooled(spreads: list[Interval]) -> Interval:
    """Root mean square of spreads that all rest on the same prints, with one's freedom."""
    known = [s for s in spreads if s.df >= 1]
    if not known:
        return UNKNOWN
    value = rms([s.value for s in known])
    return sd_interval(value, min(s.df for s in known))
