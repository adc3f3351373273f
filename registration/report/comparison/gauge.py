"""Report tables of a gauge R&R study: variance sources, each vessel, budget against repeats."""

from __future__ import annotations

import math
from typing import Any, Final

from registration.comparison.gauge import GaugeQuantity, GaugeStudy
from registration.comparison.gauge.findings import WORDS
from registration.comparison.gauge.shares import NAMES
from registration.report.comparison.sections import interval_text
from registration.report.tables import Column, Table, make_table
from registration.report.wording import fixed, number

SOURCE_COLUMNS: Final = (
    Column("quantity", "Quantity", kind="text"),
    Column("source", "Source", kind="text"),
    Column("sd", "SD, µm (95 %)", kind="text"),
    Column("total", "Of total, % (95 %)", kind="text"),
    Column("tolerance", "6 SD of tolerance, % (95 %)", kind="text"),
    Column("ndc", "ndc (95 %)", kind="text"),
)
VESSEL_COLUMNS: Final = (
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
        s, row = q.shares.sources, dict[str, Any](vessel=q.vessel)
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
    return make_table("gauge-vessels", rows, VESSEL_COLUMNS)


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
