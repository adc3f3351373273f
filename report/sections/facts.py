"""Report facts and tables from report.json: fits, vessels, flow, oxygen, checks, timing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from registration.json_ready import Record, is_number
from report.sections.tables import MAX_ROWS, Column, Table, make_table
from report.wording import (
    MISSING,
    decimals_for,
    duration,
    fixed,
    label_and_unit,
    number,
    plain,
)

VESSEL_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("kind", "Kind", kind="text"),
    Column("designed_um", "Designed", "µm"),
    Column("measured_um", "Measured", "µm"),
    Column("measured_interval_95_um", "± (95 %)", "µm"),
    Column("error_percent", "Error", "%", "signed"),
    Column("conformance", "Conforms, probability", "%", factor=100.0),
    Column("decision", "Decision", kind="text"),
    Column("narrowest_um", "Narrowest", "µm"),
    Column("ovality", "Ovality", digits=4),
    Column("offset_um", "Axis offset", "µm"),
    Column("offset_interval_95_um", "± (95 %)", "µm"),
    Column("rms_um", "RMS dev.", "µm"),
    Column("length_mm", "Length", "mm"),
    Column("seen_fraction", "Seen", "%", factor=100.0),
    Column("gauged_fraction", "Gauged", "%", factor=100.0),
    Column("open", "Open", kind="mark"),
)
FLOW_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("kind", "Kind", kind="text"),
    Column("diameter_mm", "Diameter", "mm"),
    Column("length_mm", "Length", "mm"),
    Column("flow_ml_min", "Flow", "mL/min", digits=4),
    Column("velocity_mm_s", "Velocity", "mm/s", digits=4),
    Column("pressure_in_mmhg", "Pressure in", "mmHg"),
    Column("pressure_out_mmhg", "Pressure out", "mmHg"),
    Column("wall_shear_pa", "Wall shear at mean radius", "Pa", digits=4),
    Column("wall_shear_band", "Band", kind="text"),
)
FIDELITY_COLUMNS: Final = (
    Column("fidelity", "Fidelity", kind="text"),
    Column("flow_off_ul_min", "Flow", "µL/min", digits=3),
    Column("flow_off_percent_of_inlet", "of the inlet's", "%", digits=3),
    Column("pressure_off_mmhg", "Pressure", "mmHg", digits=3),
    Column("pressure_off_percent_of_inlet", "of the inlet's", "%", digits=3),
    Column("flow_spread_percent", "Spread of flow across vessels", "%", digits=3),
)
OXYGEN_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("kind", "Kind", kind="text"),
    Column("diameter_mm", "Diameter", "mm"),
    Column("length_mm", "Length", "mm"),
    Column("oxygen_in_millimolar", "In", "mM", digits=4),
    Column("oxygen_out_millimolar", "Out", "mM", digits=4),
    Column("oxygen_in_mmhg", "In", "mmHg"),
    Column("oxygen_out_mmhg", "Out", "mmHg"),
    Column("wall_flux_nmol_s", "To the tissue", "nmol/s", digits=4),
)
CHECK_COLUMNS: Final = (
    Column("check", "Check", kind="text"),
    Column("value", "Value", kind="text"),
    Column("limit", "Limit", kind="text"),
    Column("unit", "Unit", kind="text"),
    Column("passed", "Passed", kind="mark"),
    Column("place", "Where", kind="text"),
)
LOOK_COLUMNS: Final = (
    Column("look", "Look", kind="text"),
    Column("mark", "At", kind="text"),
    Column("way_mm", "Way", "mm", digits=4),
    Column("judged", "Judged", "%", factor=100.0),
    Column("ink", "Ink, look", "%", factor=100.0),
    Column("scan_known", "Told", "%", factor=100.0),
    Column("scan_ink", "Ink, scan", "%", factor=100.0, digits=4),
    Column("scan_missing_mm", "Missing", "mm"),
    Column("agree", "Agree", kind="mark"),
    Column("words", "In words", kind="text"),
)
LOOK_NOTE: Final = (
    "Each look beside what the final scan has of the same lines, from the look before on. Judged: "
    "the share of their way that the look could judge; ink, look: the share of that with ink, "
    "before its mend. Told: the share that the scan can tell; ink, scan: the share of that where "
    "it has gel (of filaments in a bath: lumen) in the middle of the line, laid on the design by "
    "the scaled fit; missing: stretches along a line without, longer than the tolerated gap. The "
    "scan shows the part at the end, so what was dragged or melted after the look is missing, too."
)
LUMEN_COLUMNS: Final = (
    Column("lumen", "Vessel", kind="text"),
    Column("designed_mm", "Designed", "mm", digits=3),
    Column("narrowest_mm", "Narrowest", "mm", digits=3),
    Column("stepped_mm", "After steps", "mm", digits=3),
    Column("diameter_error_median_um", "Median off", "µm", "signed"),
    Column("conductance", "Conductance", "%", factor=100.0, digits=4),
    Column("stepped_conductance", "After steps", "%", factor=100.0, digits=4),
    Column("layer", "Layer", kind="text"),
    Column("at", "Narrowest at", kind="text"),
)
_SIZES: Final = ("extent", "shape", "voxel")
FIT_KEYS: Final = ("rms_um", "mean_um", "median_um", "sd_um", "p95_um")


@dataclass(frozen=True)
class Fact:
    """A line of a list of facts."""

    label: str
    value: str
    unit: str = ""


def mapping(data: Any, key: str) -> Mapping[str, Any]:
    """The dict under ``key``, or an empty one where there is none."""
    value = data.get(key) if isinstance(data, Mapping) else None
    return value if isinstance(value, Mapping) else {}


def records(section: Mapping[str, Any], key: str) -> list[Record]:
    """The list of dicts under ``key``, or an empty one."""
    value = section.get(key)
    return [r for r in value if isinstance(r, Mapping)] if isinstance(value, list) else []


def facts(section: Mapping[str, Any], skip: Sequence[str] = ()) -> list[Fact]:
    """Every plain entry of a section, labelled by its key."""
    result = []
    for key, value in section.items():
        if key in skip or isinstance(value, Mapping):
            continue
        label, unit = label_and_unit(str(key))
        if unit == "s" and is_number(value):
            result.append(Fact(label, duration(value)))
        else:
            text = MISSING if value is None else plain(value)
            if isinstance(value, list) and key.startswith(_SIZES):
                text = " × ".join(plain(v) for v in value)
            result.append(Fact(label, text, unit if text != MISSING else ""))
    return result


def fit_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Statistics of the two fits: label, rigid, scaled."""
    rigid, scaled = mapping(registration, "rigid"), mapping(registration, "scaled")
    if not rigid and not scaled:
        return []
    keys = [k for k in FIT_KEYS if k in rigid or k in scaled]
    decimals = decimals_for([f.get(k) for f in (rigid, scaled) for k in keys])
    rows = []
    for key in keys:
        label, unit = label_and_unit(key)
        pair = (fixed(fit.get(key), decimals) for fit in (rigid, scaled))
        rows.append((f"{label} / {unit}", *pair))
    # Of lumens and outer faces together no share is given where they are known apart.
    mixed = not any(surfaces(registration))
    for bound in {**mapping(rigid, "within"), **mapping(scaled, "within")} if mixed else ():
        shares = (mapping(fit, "within").get(bound) for fit in (rigid, scaled))
        pair = (fixed(100 * s if is_number(s) else None, 1) for s in shares)
        rows.append((f"Within ± {bound} µm / %", *pair))
    return [(row[0], row[1], row[2]) for row in rows]


def surfaces(registration: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Lumens and outer faces by name, where they are known apart; else the whole without name."""
    parts = mapping(registration, "by_surface")
    known = {
        name: mapping(parts, key)
        for key, name in (("lumens", "lumens"), ("outer_faces", "outer faces"))
        if "histogram" in mapping(parts, key)
    }
    return known or {"": registration}


def surface_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Statistics of lumens and outer faces apart: label, rigid and scaled of each."""
    parts = mapping(registration, "by_surface")
    fits = [
        mapping(mapping(parts, name), fit)
        for name in ("lumens", "outer_faces")
        for fit in ("rigid", "scaled")
    ]
    if not any(fits):
        return []
    rows = []
    for key in FIT_KEYS:
        label, unit = label_and_unit(key)
        a, b, c, d = (fixed(fit.get(key), 1) for fit in fits)
        rows.append((f"{label} / {unit}", a, b, c, d))
    for bound in next((fit["within"] for fit in fits if "within" in fit), {}):
        shares = [mapping(fit, "within").get(bound) for fit in fits]
        a, b, c, d = (fixed(100 * s if is_number(s) else None, 1) for s in shares)
        rows.append((f"Within ± {bound} µm / %", a, b, c, d))
    return rows


def place_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Places where outer faces stand out: deviation, area, x, y, z."""
    places = records(mapping(mapping(registration, "by_surface"), "outer_faces"), "places")
    return [
        (fixed(one["deviation_um"], 0), fixed(one["area_mm2"], 2), x, y, z)
        for one in places
        for x, y, z in [[fixed(value, 2) for value in one["at_mm"]]]
    ]


def vessel_summary(registration: Mapping[str, Any]) -> list[Fact]:
    """The vessels together: how many are open, how far off they are at most and on average."""
    rows = records(registration, "vessels")
    result = [Fact("Vessels gauged", number(len(rows)))] if rows else []
    known = [r["open"] for r in rows if isinstance(r.get("open"), bool)]
    if known:
        result.append(Fact(_open_word(registration), f"{sum(known)} of {len(known)}"))
    errors = numbers(rows, "error_percent")
    if errors:
        mean = sum(errors) / len(errors)
        result.append(Fact("Mean diameter error", number(mean, 3), "%"))
        result.append(Fact("Mean size of the error", number(_mean_size(errors), 3), "%"))
    for key, label, pick in (
        ("narrowest_um", "Narrowest section", min),
        ("offset_um", "Largest axis offset", max),
        ("rms_um", "Largest RMS deviation", max),
    ):
        values = numbers(rows, key)
        if values:
            result.append(Fact(label, number(pick(values), 3), "µm"))
    return result


def numbers(rows: Sequence[Record], key: str) -> list[float]:
    """The finite numbers under ``key``."""
    return [float(r[key]) for r in rows if is_number(r.get(key))]


def _mean_size(values: Sequence[float]) -> float:
    return sum(abs(v) for v in values) / len(values)


def vessel_table(registration: Mapping[str, Any]) -> Table | None:
    """The gauged vessels; where not all can be shown, the blocked and the worst ones."""
    rows = records(registration, "vessels")
    if len(rows) > MAX_ROWS:
        rows.sort(key=_by_error)
    bars = ("designed_um", "measured_um")
    order = "blocked, then by error"
    columns = (*VESSEL_COLUMNS[:-1], replace(VESSEL_COLUMNS[-1], label=_open_word(registration)))
    return make_table("vessels", rows, columns, bars, order) if rows else None


def _open_word(registration: Mapping[str, Any]) -> str:
    """Name of a vessel's ``open``: a solid cord isn't open but unbroken."""
    return "Unbroken" if registration.get("written") == "cords" else "Open"


def _by_error(record: Record) -> tuple[bool, float]:
    error = record.get("error_percent")
    return (record.get("open") is not False, -abs(error) if is_number(error) else 0.0)


def flow_table(flow: Mapping[str, Any]) -> Table | None:
    """The flow solution; where not all can be shown, the strongest flows."""
    rows = records(flow, "vessels")
    if len(rows) > MAX_ROWS:
        rows.sort(key=_by_flow)
    return make_table("flow", rows, FLOW_COLUMNS, order="by flow") if rows else None


def fidelity_table(fidelities: Mapping[str, Any]) -> Table | None:
    """How far each fidelity is from the ideal."""
    comparison = mapping(fidelities, "comparison")
    rows = [{"fidelity": k, **v} for k, v in comparison.items() if isinstance(v, Mapping)]
    if not rows:
        return None
    spread = {"flow_spread_percent": comparison.get("ideal_flow_spread_percent")}
    return make_table("fidelities", [{"fidelity": "ideal", **spread}, *rows], FIDELITY_COLUMNS)


def oxygen_table(oxygen: Mapping[str, Any]) -> Table | None:
    """Oxygen in the vessels; where not all can be shown, those that it leaves with least."""
    rows = records(oxygen, "vessels")
    if len(rows) > MAX_ROWS:
        rows.sort(key=_by_oxygen)
    order = "least oxygen at the end first"
    return make_table("oxygen", rows, OXYGEN_COLUMNS, order=order) if rows else None


def _by_oxygen(record: Record) -> float:
    left = record.get("oxygen_out_millimolar")
    return float(left) if is_number(left) else math.inf


def _by_flow(record: Record) -> float:
    flow = record.get("flow_ml_min")
    return -abs(flow) if is_number(flow) else 0.0


def check_table(dry_run: Mapping[str, Any]) -> Table | None:
    """The dry run's checks, the failed ones first."""
    rows = sorted(records(dry_run, "checks"), key=lambda r: r.get("passed") is not False)
    return make_table("checks", rows, CHECK_COLUMNS, order="failed first") if rows else None


def look_table(rows: Sequence[Record]) -> Table | None:
    """Looks at the print held against the final scan, those that disagree first."""
    ordered = sorted(rows, key=lambda r: (r.get("agree") is not False, r.get("agree") is True))
    return (
        make_table("looks", ordered, LOOK_COLUMNS, order="disagreeing ones first") if rows else None
    )


def lumen_table(lumens: Mapping[str, Any]) -> Table | None:
    """What the G-code leaves open of each vessel, those that lose most first."""
    rows = [_lumen(row) for row in records(lumens, "lumens")]
    if not rows:
        return None
    return make_table("lumens", rows, LUMEN_COLUMNS, order="by conductance lost")


def lumen_facts(lumens: Mapping[str, Any]) -> list[Fact]:
    """The lumens together: closed, leaking or merging ones, and what conductance is left."""
    summary = mapping(lumens, "summary")
    counts = (
        ("closed", "Closed"),
        ("leaks", "Leaking"),
        ("joints", "Joints"),
        ("joints_broken", "Joints broken"),
        ("merges", "Filaments merging"),
    )
    filaments = lumens.get("method") == "filaments"
    rows = [
        Fact(label, number(summary[key]))
        for key, label in counts
        if is_number(summary.get(key)) and not (filaments and key == "leaks")
    ]
    for key, label in (
        ("stepped_conductance_median", "Median conductance, after motor steps"),
        ("stepped_conductance_least", "Least conductance, after motor steps"),
    ):
        if is_number(summary.get(key)):
            rows.append(Fact(label, number(100 * float(summary[key]), 4), "% of the design's"))
    return rows


def _lumen(row: Record) -> dict[str, object]:
    stepped, layer = mapping(row, "stepped"), row.get("layer")  # which counts from 0
    at = row.get("at_mm")
    return {
        **row,
        "layer": layer + 1 if isinstance(layer, int) else layer,
        "stepped_mm": stepped.get("narrowest_mm"),
        "stepped_conductance": stepped.get("conductance"),
        "at": ", ".join(f"{v:.2f}" for v in at) if isinstance(at, list) else None,
    }


def timing_rows(timings: Mapping[str, Any]) -> list[dict[str, object]]:
    """Stages with seconds, peak memory, whether reused, and share of the longest."""
    stages = [(name, t) for name, t in timings.items() if isinstance(t, Mapping)]
    seconds = [t.get("seconds") for _, t in stages]
    top = max((s for s in seconds if is_number(s)), default=0.0)
    return [
        {
            "stage": name,
            "seconds": fixed(t.get("seconds"), 2),
            "peak_mb": fixed(t.get("peak_mb"), 0),
            "reused": t.get("reused") is True,
            "share": 100.0 * t["seconds"] / top if is_number(t.get("seconds")) and top else 0.0,
        }
        for name, t in stages
    ]
