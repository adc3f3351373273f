"""Write the comparison of several prints as one self-contained HTML file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from design.files import write_text
from registration.comparison import Comparison
from registration.comparison import notes as standing_notes
from registration.comparison import verdict as found_verdict
from registration.comparison.gauge_findings import WORDS, gauge_notes, gauge_sentences
from registration.comparison.gauge_shares import NAMES
from registration.comparison.gauge_study import GaugeQuantity, GaugeStudy
from registration.comparison.overall import Quantity
from registration.comparison.statistics import Interval, Trend
from registration.comparison.vessels import VesselSpread
from report.figures.comparison_figures import (
    TITLES,
    along_figure,
    history_figure,
    quantities_figure,
    vessels_figure,
)
from report.page_frame import render
from report.sections.facts import Fact
from report.sections.key_figures import KeyFigure
from report.sections.tables import MAX_ROWS, Column, Table, make_table
from report.svg import inline_figure
from report.wording import MISSING, fixed, number

# Report tables of a gauge R&R study: variance sources, each vessel, budget against repeats.
SOURCE_COLUMNS: Final = (
    Column("quantity", "Quantity", kind="text"),
    Column("source", "Source", kind="text"),
    Column("sd", "SD, µm (95 %)", kind="text"),
    Column("total", "Of total, % (95 %)", kind="text"),
    Column("tolerance", "6 SD of tolerance, % (95 %)", kind="text"),
    Column("ndc", "ndc (95 %)", kind="text"),
)
GAUGE_VESSEL_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("EV", "EV, µm (95 %)", kind="text"),
    Column("AV", "AV, µm", kind="text"),
    Column("INT", "INT, µm", kind="text"),
    Column("GRR", "GRR, µm (95 %)", kind="text"),
    Column("PV", "PV, µm", kind="text"),
    Column("TV", "TV, µm", kind="text"),
    Column("total", "GRR of total, %", kind="text"),
    Column("tolerance", "GRR of tolerance, % (95 %)", kind="text"),
    Column("ndc", "ndc", kind="text"),
    Column("offset", "Offset EV, µm (95 %)", kind="text"),
)
CLAIM_COLUMNS: Final = (
    Column("name", "Of", kind="text"),
    Column("claimed", "Budget, type A, µm", kind="text"),
    Column("seen", "Repeats, SD, µm", kind="text"),
    Column("p", "p", kind="text"),
    Column("verdict", "Budget's share", kind="text"),
)
_TITLES: Final = {
    "diameters": "Diameter, all vessels",
    "offsets": "Axis offset, all vessels",
    "radial_offset": "Radial offset",
}


def gauge_tables(study: GaugeStudy) -> list[tuple[str, Table]]:
    """Return headings and tables: pooled sources, each vessel, claims of the budgets."""
    made = [
        ("Sources of variation", _source_table(study)),
        ("Each vessel", _vessel_table(study)),
        ("Budget against repeats", _claim_table(study)),
    ]
    return [(heading, table) for heading, table in made if table.rows]


def _source_table(study: GaugeStudy) -> Table:
    rows = [
        {
            "quantity": _TITLES[q.name],
            "source": f"{name}, {WORDS[name]}",
            "sd": interval_text(share.sd, 2),
            "total": interval_text(share.of_total, 1),
            "tolerance": interval_text(share.of_tolerance, 1),
            "ndc": _ndc(q) if name == "TV" else None,
        }
        for q in study.quantities
        if q.vessel is None
        for name in NAMES
        for share in [q.shares.sources[name]]
        if math.isfinite(share.sd.value)
    ]
    return make_table("gauge", rows, SOURCE_COLUMNS)


def _ndc(quantity: GaugeQuantity) -> str | None:
    if quantity.shares.ndc_interval is None:
        return None
    low, high = quantity.shares.ndc_interval
    return f"{number(quantity.shares.ndc)} ({low} to {high})"


def _vessel_table(study: GaugeStudy) -> Table:
    offsets = {q.vessel: q for q in study.quantities if q.name.startswith("offset_")}
    rows = []
    for q in study.quantities:
        if q.vessel is None or not q.name.startswith("diameter_"):
            continue
        s, row = q.shares.sources, dict[str, object](vessel=q.vessel)
        row |= {name: _plain(s[name].sd.value) for name in NAMES}
        row |= {name: interval_text(s[name].sd, 2) for name in ("EV", "GRR")}
        row |= {
            "total": _plain(s["GRR"].of_total.value),
            "tolerance": interval_text(s["GRR"].of_tolerance, 1),
            "ndc": None if q.shares.ndc is None else number(q.shares.ndc),
        }
        other = offsets.get(q.vessel)
        row["offset"] = None if other is None else interval_text(other.shares.sources["EV"].sd, 2)
        rows.append(row)
    return make_table("gauge-vessels", rows, GAUGE_VESSEL_COLUMNS)


def _plain(value: float) -> str | None:
    return fixed(value, 2) if math.isfinite(value) else None


def _claim_table(study: GaugeStudy) -> Table:
    rows = [
        {
            "name": claim.name,
            "claimed": _plain(claim.claimed_um),
            "seen": _plain(claim.seen_um),
            "p": number(claim.p, 2) if math.isfinite(claim.p) else None,
            "verdict": claim.verdict,
        }
        for claim in study.claims
    ]
    return make_table("gauge-claims", rows, CLAIM_COLUMNS)


# Key figures, facts and tables of a print comparison, formatted for its page and PDF.
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
            row: dict[str, object] = {q.name: q.values[n] for q in comparison.quantities}
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


def _trend_row(quantity: Quantity) -> dict[str, object]:
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


def _vessel_row(vessel: VesselSpread) -> dict[str, object]:
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


Drawn = Mapping[str, tuple[str, bytes]]
"""Name to caption and drawing (SVG)."""
_ENTRY: Final = 'import { startPage } from "viewer/page"; startPage();'


def write_comparison_html(
    path: Path,
    comparison: Comparison,
    title: str,
    notes: Sequence[str] = (),
    drawn: Drawn | None = None,
) -> None:
    """Write a comparison as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    comparison : Comparison
    title : str
        Of the design, usually.
    notes : sequence of str
        Sentences to those that follow from the comparison itself.
    drawn : dict or None
        Of `comparison_figures`, where they are drawn already.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    write_text(path, comparison_html(comparison, title, notes, drawn))


def comparison_html(
    comparison: Comparison, title: str, notes: Sequence[str] = (), drawn: Drawn | None = None
) -> str:
    """The text of the page; same input, same text."""
    drawn = comparison_figures(comparison) if drawn is None else drawn
    context = {
        "title": title,
        "facts": facts(comparison),
        "data": {"verdict": found_verdict(comparison)},
        "key_figures": key_figures(comparison),
        "figures": {
            name: inline_figure(picture, caption, f"{name}-")
            for name, (caption, picture) in drawn.items()
        },
        "captions": {name: caption for name, (caption, _) in drawn.items()},
        "print_table": print_table(comparison),
        "vessel_table": vessel_table(comparison),
        "trend_table": trend_table(comparison),
        "shared_table": shared_table(comparison),
        "spread_facts": spread_facts(comparison),
        "gauge": comparison.gauge
        and {
            "sentences": gauge_sentences(comparison.gauge),
            "tables": gauge_tables(comparison.gauge),
            "notes": gauge_notes(comparison.gauge),
        },
        "notes": [*notes, *standing_notes(comparison)],
    }
    return render("comparison.html", context, _ENTRY)


def facts(comparison: Comparison) -> list[str]:
    """A few words for the top of the page."""
    return [
        f"{number(len(comparison.prints))} prints, {number(len(comparison.scans))} scans",
        f"{number(len(comparison.vessels))} vessels",
        f"design {comparison.scans[0].design[:12]}",
    ]


def comparison_figures(comparison: Comparison) -> Drawn:
    """Name to caption and drawing (SVG)."""
    made = {
        "quantities": (
            "By print: each scan with the 95 % interval of its own registration, the prints' "
            "mean and its 95 % interval (band)",
            quantities_figure(comparison),
        ),
        "vessels": (
            "Diameter error of each vessel: mean over the prints with its 95 % interval, each "
            "print (small), tolerance (ticks)",
            vessels_figure(comparison),
        ),
        "history": ("Diameter error from print to print", history_figure(comparison)),
        "along": (
            "Diameter along the vessels: every scan, the later the darker; designed (line)",
            along_figure(comparison),
        ),
    }
    return {
        name: (caption, picture) for name, (caption, picture) in made.items() if picture is not None
    }
