"""Report tables and facts: defects, overlap with the design, topology, perfusion as printed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from registration.json_ready import Record, is_number
from registration.measuring.judging import list_findings
from report.sections.facts import Fact, mapping, records
from report.sections.tables import Column, Table, make_table
from report.wording import MISSING, fixed, number

DEFECT_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("kind", "Defect", kind="text"),
    Column("to", "Leads to", kind="text"),
    Column("at_mm", "At", "mm"),
    Column("extent", "From – to, mm", kind="text"),
    Column("place", "Place x, y, z, mm", kind="text"),
    Column("size_um", "Size", "µm"),
    Column("error_um", "± (95 %)", "µm"),
    Column("deviation", "Off the design, %", kind="text"),
    Column("limit", "Limit", kind="text"),
    Column("decision", "Decision", kind="text"),
    Column("percent", "Of the diameter", "%", "signed"),
    Column("wall_um", "Wall moved", "µm", "signed"),
    Column("seen", "All seen", kind="mark"),
    Column("source", "Written by", kind="text"),
    Column("lines", "G-code lines", kind="text"),
)
PERFUSION_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("designed_resistance_pa_s_ul", "Resistance, designed", "Pa·s/µL", digits=6),
    Column("resistance_pa_s_ul", "As printed", "Pa·s/µL", digits=6),
    Column("ratio", "Printed over designed", digits=4),
    Column("interval", "95 % interval", kind="text"),
    Column("designed_share", "Share of flow, designed", "%", factor=100.0),
    Column("share", "As printed", "%", factor=100.0),
    Column("measured", "Measured", kind="mark"),
    Column("fed", "Fed", kind="mark"),
)


def two_way_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """What is compared over both fits beside the scan's own statistics: label, rigid, scaled."""
    back = [mapping(registration, f"{fit}_model_to_scan") for fit in ("rigid", "scaled")]
    overlaps = [mapping(mapping(registration, "overlap"), fit) for fit in ("rigid", "scaled")]
    hausdorff = mapping(registration, "hausdorff_p95_um")
    wanted = (
        ("Design to scan, RMS / µm", [b.get("rms_um") for b in back], 1),
        ("Design to scan, 95th percentile / µm", [b.get("p95_um") for b in back], 1),
        ("95 % Hausdorff distance / µm", [hausdorff.get(fit) for fit in ("rigid", "scaled")], 1),
        ("Dice of the lumens", [o.get("dice") for o in overlaps], 3),
        ("Lumen volume, printed / designed", [o.get("volume_ratio") for o in overlaps], 3),
    )
    return [
        (label, fixed(rigid, decimals), fixed(scaled, decimals))
        for label, (rigid, scaled), decimals in wanted
        if is_number(rigid) or is_number(scaled)
    ]


def defect_table(registration: Mapping[str, Any]) -> Table | None:
    """The defects that were found, in the network's order."""
    rows = [_defect(row) for row in list_findings(registration)]
    return make_table("defects", rows, DEFECT_COLUMNS, order="by vessel") if rows else None


def _defect(row: Record) -> dict[str, object]:
    to = {"leak": "outside", "bridge": f"vessel {row.get('other')}"}.get(str(row.get("kind")))
    if row.get("doubt"):
        to = f"{to}, or {'a shadow' if row['doubt'] == 'shade' else 'thin gel'}"
    place = row.get("point_mm")
    made = mapping(row, "made_by")
    return {
        **row,
        "to": to,
        "deviation": _off(row),
        "extent": _span(row.get("from_mm"), row.get("to_mm")),
        # Of a missing vessel the designed diameter is given, which nobody measured.
        "error_um": None if row.get("kind") == "missing" else row.get("error_um"),
        "place": ", ".join(f"{v:.2f}" for v in place) if isinstance(place, list | tuple) else None,
        "source": _source(made),
        "lines": f"{made.get('first_line')} – {made.get('last_line')}"
        if made.get("line_count")
        else None,
    }


def _off(row: Record) -> str | None:
    """Deviation from the design with its interval, percent."""
    off, half, um = row.get("deviation_percent"), row.get("u_um"), row.get("deviation_um")
    if not (is_number(off) and is_number(um)):
        return None
    if not is_number(half) or not um:
        return fixed(off, 1)
    return f"{fixed(off, 1)} ± {fixed(abs(half * off / um), 1)}"


def _span(first: Any, last: Any) -> str | None:
    if not (is_number(first) and is_number(last)):
        return None
    return f"{first:.2f} – {last:.2f}"


def _source(made: Mapping[str, Any]) -> str | None:
    for name in ("layers", "vessels"):
        source = made.get(name)
        if isinstance(source, list) and source:
            word = name[:-1] if len(source) == 1 else name
            few = source if len(source) < 4 else [f"{source[0]} to {source[-1]}"]
            return f"{word} {', '.join(map(str, few))}"
    return None


def perfusion_table(registration: Mapping[str, Any]) -> Table | None:
    """Resistance and share of the flow of each vessel, as designed and as printed."""
    sure = {
        row.get("vessel"): row.get("resistance_ratio_interval_95")
        for row in records(registration, "vessels")
    }
    driven = records(mapping(registration, "perfusion"), "vessels")
    rows = [_driven(row, sure.get(row.get("vessel"))) for row in driven]
    return make_table("perfusion", rows, PERFUSION_COLUMNS, order="by number") if rows else None


def _driven(row: Record, ends: Any) -> dict[str, object]:
    printed, designed = row.get("resistance_pa_s_ul"), row.get("designed_resistance_pa_s_ul")
    ratio = printed / designed if is_number(printed) and is_number(designed) else None
    known = isinstance(ends, list | tuple) and len(ends) == 2 and all(map(is_number, ends))
    return {**row, "ratio": ratio, "interval": f"{ends[0]:.3f} – {ends[1]:.3f}" if known else None}


def printed_facts(registration: Mapping[str, Any]) -> list[Fact]:
    """Topology and perfusion in a few lines."""
    result = []
    topology, flow = mapping(registration, "topology"), mapping(registration, "perfusion")
    if topology:
        result += [
            Fact("Components, loops: designed", _betti(mapping(topology, "designed"))),
            Fact("Components, loops: printed", _betti(mapping(topology, "printed"))),
            Fact("Hangs together as designed", _text(topology.get("as_designed"))),
        ]
        if topology.get("as_designed") is False:
            closed = _text(topology.get("explained"))
            result.append(Fact("Explained by the closed vessels and bridges", closed))
    if flow:
        result.append(Fact("Perfuses as printed", _text(flow.get("perfused"))))
        for key, label in (
            ("designed_pressure_drop_pa", "Pressure drop, designed"),
            ("pressure_drop_pa", "Pressure drop, as printed"),
        ):
            if is_number(flow.get(key)):
                result.append(Fact(label, number(flow[key], 3), "Pa"))
        if is_number(flow.get("pressure_ratio")):
            result.append(Fact("Pressure needed, of the designed", pressure_words(flow), "times"))
    seen = registration.get("model_seen_fraction")
    if is_number(seen):
        result.append(Fact("Design's surface seen", number(100 * seen, 3), "%"))
    return result


def pressure_words(flow: Mapping[str, Any]) -> str:
    """Return the pressure ratio with its 95 % interval: "1.06 [0.98, 1.15]"."""
    ends = list(flow.get("pressure_ratio_interval_95") or [])
    said = f"{flow['pressure_ratio']:.2f}"
    if len(ends) == 2 and all(map(is_number, ends)):
        return f"{said} [{ends[0]:.2f}, {ends[1]:.2f}]"
    return f"{said} (interval not known)"


def _betti(numbers: Mapping[str, Any]) -> str:
    return f"{number(numbers.get('components'))}, {number(numbers.get('loops'))}"


def _text(value: Any) -> str:
    if not isinstance(value, bool):
        return f"not known ({MISSING})"
    return "yes" if value else "no"
