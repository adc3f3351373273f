"""Key figures, facts and tables of a print comparison, formatted for its page and PDF."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from typing import Any, Final

from registration.comparison import Comparison
from registration.comparison.intervals import Interval
from registration.comparison.overall import Quantity
from registration.comparison.trend import Trend
from registration.comparison.vessels import VesselSpread
from registration.report.comparison.figures import TITLES
from registration.report.key_figures import KeyFigure
from registration.report.sections import Fact
from registration.report.tables import MAX_ROWS, Column, Table, make_table
from registration.report.wording import MISSING, fixed, number

VESSEL_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("designed_um", "Designed", "µm"),
    Column("mean", "Mean error", "µm", "signed"),
    Column("mean_span", "95 %", "µm", kind="text"),
    Column("observed", "SD of prints", "µm"),
    Column("observed_span", "95 %", "µm", kind="text"),
    Column("scan", "SD of scans", "µm"),
    Column("print", "less scan noise", "µm"),
    Column("along", "SD along it", "µm"),
    Column("off", "Off", kind="text"),
    Column("beyond", "Beyond the others", kind="text"),
    Column("varies", "Varies", kind="text"),
    Column("drift", "Drift", "µm/print", "signed"),
    Column("cp", "Cp (95 %)", kind="text"),
    Column("cpk", "Cpk (95 %)", kind="text"),
    Column("open", "Open in", kind="text"),
)
PRINT_COLUMNS: Final = (
    Column("print", "Print", kind="text"),
    Column("label", "Scan", kind="text"),
    Column("when", "Printed, UTC", kind="text"),
    Column("passed", "Passed", kind="mark"),
    Column("mean_diameter_error", "Mean error", "µm", "signed"),
    Column("scale_x", "Scale x", "%", "signed"),
    Column("scale_y", "Scale y", "%", "signed"),
    Column("scale_z", "Scale z", "%", "signed"),
    Column("offset", "Offset", "µm", "signed"),
    Column("rms_deviation", "RMS dev.", "µm"),
)
TREND_COLUMNS: Final = (
    Column("name", "Quantity", kind="text"),
    Column("mean", "Mean (95 %)", kind="text"),
    Column("sd", "SD of prints (95 %)", kind="text"),
    Column("slope", "Change a print (95 %)", kind="text"),
    Column("day", "Change a day (95 %)", kind="text"),
    Column("p", "p of no trend", kind="text"),
)
SHARED_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("kind", "Defect", kind="text"),
    Column("extent", "From – to, mm", kind="text"),
    Column("in_prints", "In prints", kind="text"),
    Column("common", "Common", kind="text"),
    Column("seen", "In view in", kind="text"),
    Column("sizes", "Sizes, µm", kind="text"),
)


def span(interval: Interval, decimals: int = 1) -> str | None:
    """``−5.0 to 1.2``; None where nothing is known."""
    if not math.isfinite(interval.low):
        return None
    return f"{fixed(interval.low, decimals)} to {fixed(interval.high, decimals)}"


def interval_text(interval: Interval, decimals: int = 1, unit: str = "") -> str | None:
    """``−1.9 µm (−5.0 to 1.2)``."""
    if not math.isfinite(interval.value):
        return None
    value = f"{fixed(interval.value, decimals)}{' ' + unit if unit else ''}"
    return f"{value} ({span(interval, decimals)})" if span(interval) else value


def key_figures(comparison: Comparison) -> list[KeyFigure]:
    """The handful of numbers a reader wants first."""
    known = [p.passed for p in comparison.prints if p.passed is not None]
    mean = comparison.quantity("mean_diameter_error").parts.mean
    pooled = comparison.repeatability
    made = [
        KeyFigure("Prints that pass", f"{sum(known)} of {len(known)}" if known else MISSING),
        KeyFigure("Mean diameter error", fixed(mean.value, 1), "µm", _note(mean)),
        KeyFigure(
            "Print to print, SD",
            fixed(pooled.observed_sd.value, 1),
            "µm",
            _note(pooled.observed_sd),
        ),
    ]
    if pooled.scan_sd.df >= 1:
        note = _note(pooled.scan_sd)
        made.append(KeyFigure("Scan to scan, SD", fixed(pooled.scan_sd.value, 1), "µm", note))
    common = sum(d.common for d in comparison.defects)
    if comparison.defects:
        alone = f"{len(comparison.defects) - common} in one print alone"
        made.append(KeyFigure("Common defects", number(common), "", alone))
    return made


def _note(interval: Interval) -> str:
    return f"95 %: {span(interval)}" if span(interval) else ""


def spread_facts(comparison: Comparison) -> list[Fact]:
    """Repeatability in the words of a gauge study."""
    pooled = comparison.repeatability
    known = pooled.scan_sd.df >= 1
    missing = "no print was scanned twice"
    return [
        Fact("Vessels measured in every scan", f"{pooled.vessels} of {len(comparison.vessels)}"),
        Fact("Print to print as measured, SD",
             interval_text(pooled.observed_sd, 1, "µm") or MISSING),
        Fact("Scan to scan of one print (repeatability), SD",
             (interval_text(pooled.scan_sd, 1, "µm") if known else None) or missing),
        Fact("Print to print, scan noise taken out, SD",
             (interval_text(pooled.print_sd, 1, "µm") if known else None) or missing),
        Fact("Along a vessel within a print, SD", fixed(pooled.along_sd_um, 1), "µm"),
        *([Fact("Scan noise of the total spread (%GRR)", fixed(pooled.gauge_percent, 0), "%")]
          if known else []),
        *([Fact("Kinds of prints it tells apart (ndc)", number(pooled.distinct))]
          if pooled.distinct is not None else []),
    ]  # fmt: skip


def print_table(comparison: Comparison) -> Table:
    """A scan a row, by print."""
    rows = []
    for k, each in enumerate(comparison.prints):
        for n in each.scans:
            scan = comparison.scans[n]
            row: dict[str, Any] = {q.name: q.values[n] for q in comparison.quantities}
            row |= {
                "print": k + 1,
                "label": scan.label,
                "when": _when(each.started),
                "passed": scan.passed,
            }
            rows.append(row)
    return make_table("prints", rows, PRINT_COLUMNS)


def _when(started: float | None) -> str | None:
    if started is None:
        return None
    return datetime.fromtimestamp(started, UTC).strftime("%Y-%m-%d %H:%M")


def trend_table(comparison: Comparison) -> Table:
    """Mean, spread and drift of each quantity."""
    return make_table("trends", [_trend_row(q) for q in comparison.quantities], TREND_COLUMNS)


def _trend_row(quantity: Quantity) -> dict[str, Any]:
    digits = 3 if quantity.unit == "%" else 1
    unit, slope = quantity.unit, quantity.per_print
    return {
        "name": TITLES[quantity.name],
        "mean": interval_text(quantity.parts.mean, digits, unit),
        "sd": interval_text(quantity.parts.observed_sd, digits, unit),
        "slope": _slope(slope, digits, unit),
        "day": _slope(quantity.per_day, digits, unit),
        "p": "three prints needed" if slope is None else number(slope.p, 2),
    }


def _slope(slope: Trend | None, digits: int, unit: str) -> str | None:
    return None if slope is None else interval_text(slope.slope, digits, unit)


def vessel_table(comparison: Comparison) -> Table:
    """Every vessel; where not all can be shown, those farthest off."""
    chosen = list(comparison.vessels)
    if len(chosen) > MAX_ROWS:
        chosen.sort(key=lambda v: -abs(v.error.mean.value) if v.error.prints else 0.0)
    rows = [_vessel_row(v) for v in chosen]
    return make_table("vessels", rows, VESSEL_COLUMNS, order="by mean error")


def _vessel_row(vessel: VesselSpread) -> dict[str, Any]:
    error, able = vessel.error, vessel.capability
    return {
        "vessel": vessel.vessel,
        "designed_um": vessel.designed_um,
        "mean": error.mean.value,
        "mean_span": span(error.mean),
        "observed": error.observed_sd.value,
        "observed_span": span(error.observed_sd),
        "scan": error.scan_sd.value if error.scan_sd.df >= 1 else None,
        "print": error.print_sd.value if error.print_sd.df >= 1 else None,
        "along": vessel.along_sd_um,
        "off": _marked(vessel.p_off),
        "beyond": _marked(vessel.p_beyond),
        "varies": _marked(vessel.p_varies),
        "drift": None if vessel.drift is None else vessel.drift.slope.value,
        "cp": None if able is None else interval_text(able.cp, 2),
        "cpk": None if able is None else interval_text(able.cpk, 2),
        "open": f"{vessel.open} of {vessel.known}",
    }


def _marked(p: float) -> str | None:
    """``yes`` or ``no`` with the corrected probability."""
    if not math.isfinite(p):
        return None
    return f"{'yes' if p < 0.05 else 'no'} (p {'< 0.001' if p < 0.001 else f'{p:.2g}'})"


def shared_table(comparison: Comparison) -> Table | None:
    """Defects, the common ones first."""
    total = len(comparison.prints)
    rows = [
        {
            "vessel": d.vessel,
            "kind": d.kind if d.other is None else f"{d.kind} to vessel {d.other}",
            "extent": f"{d.from_mm:.2f} – {d.to_mm:.2f}",
            "in_prints": ", ".join(str(k + 1) for k in d.prints),
            "common": f"{len(d.prints)} of {total}" if d.common else "no",
            "seen": f"{d.seen} of {total}",
            "sizes": ", ".join(fixed(size, 0) for size in d.sizes_um),
        }
        for d in comparison.defects
    ]
    return make_table("shared", rows, SHARED_COLUMNS, order="common first") if rows else None
