"""Report tables of uncertainty, tolerance zones and the measurement record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

from registration.json_ready import is_number
from report.sections.facts import Fact, mapping, records
from report.sections.tables import Column, Table, make_table
from report.wording import MISSING, fixed, number, plain

LEAST_SHARE = 0.01
"""Of the variance; smaller terms stand in registration.json alone."""
BUDGET_COLUMNS = (
    Column("quantity", "Quantity", kind="text"),
    Column("term", "Term", kind="text"),
    Column("type", "Type", kind="text"),
    Column("standard", "Standard uncertainty", kind="text"),
    Column("dof", "Degrees of freedom", kind="text"),
    Column("share", "Share of variance", kind="text"),
    Column("remark", "Rests on, or is made less by", kind="text"),
)


def budget_table(registration: Mapping[str, Any]) -> Table | None:
    """Return every budget's terms and its 95 % interval; None without budgets."""
    rows = [row for budget in records(registration, "budget") for row in _rows(budget)]
    return make_table("budget", rows, BUDGET_COLUMNS, order="by quantity") if rows else None


def _rows(budget: Mapping[str, Any]) -> list[dict[str, object]]:
    unit = "µm" if budget["unit"] == "um" else budget["unit"]
    name = str(budget["quantity"]).replace("_", " ")
    rows = [
        {
            "quantity": name,
            "term": term["term"],
            "type": term["type"],
            "standard": f"{number(term['standard'], 3)} {unit}",
            "dof": _freedom(term["dof"]),
            "share": f"{100 * term['share']:.0f} %",
            "remark": term["note"],
        }
        for term in budget["terms"]
        if (term["share"] or 0.0) >= LEAST_SHARE
    ]
    total = {
        "quantity": name,
        "term": "95 % interval",
        "type": "",
        "standard": f"± {number(budget['interval_95'], 3)} {unit}",
        "dof": _freedom(budget["dof"]),
        "share": "",
        "remark": f"most is gained by: {budget['reduce']}",
    }
    return [*rows, total]


def _freedom(value: Any) -> str:
    return number(value, 2) if is_number(value) else "∞"


AXES = ("x", "y", "z")


def fitted_rows(registration: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return name, value and half of the 95 % interval of everything that was fitted."""
    interval = mapping(registration, "interval_95")
    scale, half = _three(registration.get("scale")), _three(interval.get("scale"))
    rows = [
        (f"Scale along {axis} (scan over design)", fixed(value, 5), _of_scale(width, interval))
        for axis, value, width in zip(AXES, scale, half, strict=True)
        if is_number(value)
    ]
    if is_number(registration.get("offset_um")):
        value, width = registration["offset_um"], interval.get("offset_um")
        rows.append(("Radial offset / µm", fixed(value, 2), _half(width, 2)))
    for key, label in (
        ("shift_um", "Place of the part's middle along {} / µm"),
        ("rotation_deg", "Rotation about {} / °"),
    ):
        rows += [
            (label.format(axis), "", _half(width, 2))
            for axis, width in zip(AXES, _three(interval.get(key)), strict=True)
            if is_number(width)
        ]
    return rows


def calibration_facts(registration: Mapping[str, Any]) -> list[Fact]:
    """Return whether the depth scale was fitted, and by which calibration walls were taken."""
    rows = []
    if registration.get("depth_scale_fitted") is not None:
        rows.append(Fact("Depth scale fitted", plain(registration["depth_scale_fitted"])))
    if "walls" in registration:
        walls = registration["walls"]
        rows.append(Fact("Calibration of walls", "none" if walls is None else plain(walls)))
    return rows


def print_facts(data: Mapping[str, Any]) -> list[Fact]:
    """Return when and as what a part was printed, and SHA-256 of its network and G-code."""
    printed = mapping(data, "printed")
    started = printed.get("started")
    design = mapping(mapping(data, "registration"), "design")
    when = datetime.fromtimestamp(started, UTC) if is_number(started) else None
    rows = (
        ("Printed", when and when.strftime("%Y-%m-%d %H:%M UTC")),
        ("Print", printed.get("id")),
        ("SHA-256 of G-code", printed.get("gcode_sha256")),
        ("SHA-256 of network.csv", design.get("network_sha256")),
    )
    return [Fact(label, plain(value)) for label, value in rows if value]


def _three(values: Any) -> Sequence[Any]:
    known = list(values) if isinstance(values, list | tuple) else []
    return (known + [None] * 3)[:3]


def _half(width: Any, digits: int) -> str:
    return f"± {number(width, digits)}" if is_number(width) else MISSING


def _of_scale(width: Any, interval: Mapping[str, Any]) -> str:
    """A scale that has no interval where others have one wasn't fitted."""
    return "not fitted" if width is None and interval.get("scale") else _half(width, 2)


WHOLE_COLUMNS: Final = (
    Column("quantity", "Quantity", kind="text"),
    Column("value_um", "Measured", "µm", "signed"),
    Column("u_um", "± (95 %)", "µm"),
    Column("percent", "Of the design", "%", "signed"),
    Column("limit", "Limit", kind="text"),
    Column("decision", "Decision", kind="text"),
)
_WHOLE: Final = {"rms": "RMS deviation, scaled fit", "rigid": "RMS deviation, rigid fit"}


def whole_table(registration: Mapping[str, Any]) -> Table | None:
    """Return the decisions on size and RMS deviations; None where nothing was judged."""
    features = records(mapping(registration, "judging"), "features")
    rows = [_whole(one) for one in features if one["name"] in ("size", *_WHOLE)]
    return make_table("whole", rows, WHOLE_COLUMNS, order="as judged") if rows else None


def _whole(feature: Mapping[str, Any]) -> dict[str, object]:
    if feature["name"] != "size":
        return {**feature, "quantity": _WHOLE[feature["name"]]}
    value = feature.get("value_um")
    percent = 100 * value / feature["designed_um"] if is_number(value) else None
    return {**feature, "quantity": f"Size along {feature['of']}", "percent": percent}


ZONE_COLUMNS: Final = (
    Column("feature", "Feature", kind="text"),
    Column("characteristic", "Characteristic", kind="text"),
    Column("zone_um", "Zone", "µm"),
    Column("interval", "95 % interval, µm", kind="text"),
    Column("limit_um", "Limit", "µm"),
    Column("decision", "Decision", kind="text"),
    Column("seen_fraction", "Seen", "%", factor=100.0),
    Column("note", "Note", kind="text"),
)
ZONE_NOTE: Final = (
    "ISO 1101, in the reference frame; the print isn't stretched, so that shrinkage counts. "
    "Zone: diameter about the designed axis (position, and profile of a line), radial width "
    "(cylindricity, minimum zone), width about the designed surface (profile of a surface): "
    "twice the largest distance. Over what was gauged or seen, clear of junctions and edges. "
    "Filters: Gaussian (ISO 16610), cut-off one designed diameter along a vessel, 7 "
    "undulations round it, 0.8 mm over a face. Noise makes a largest value larger: nothing is "
    "taken off the value, but the interval reaches down by all that noise alone would show."
)


def zone_table(registration: Mapping[str, Any]) -> Table | None:
    """Every characteristic with its interval, limit and decision; None without any."""
    rows = [_row(row) for row in records(registration, "characteristics")]
    return make_table("zones", rows, ZONE_COLUMNS, order="by vessel") if rows else None


def _row(row: Mapping[str, Any]) -> dict[str, object]:
    low, high = row.get("interval_95_um") or (None, None)
    known = is_number(low) and is_number(high)
    return {
        **row,
        "interval": f"{fixed(low, 0)} – {fixed(high, 0)}" if known else None,
        "seen_fraction": row.get("seen_fraction") if is_number(row.get("zone_um")) else None,
        "note": row.get("note") or None,
    }


def frame_lines(registration: Mapping[str, Any]) -> list[str]:
    """The reference frame in sentences: how it was laid, and how sure each datum's place is."""
    frame = mapping(registration, "frame")
    if not frame:
        return []
    places = [
        f"{plain(row.get('datum'))}: known to ± {fixed(row.get('interval_95_um'), 1)} µm "
        f"(95 %), {fixed(row.get('from_best_fit_um'), 1)} µm from where the best fit has it"
        for row in records(frame, "places")
    ]
    return [plain(frame.get("words")), *places]


NOT_STATED: Final = "not stated"
_LABELS: Final = {
    "part": "Part",
    "material": "Material",
    "operator": "Operator",
    "instrument": "Instrument",
    "serial": "Serial number",
    "certificate.number": "Certificate",
    "certificate.issued": "Certificate issued",
    "certificate.valid_until": "Certificate valid until",
    "certificate.by": "Certificate issued by",
    "scanned": "Time of the scan",
    "age_at_registration_h": "Age at registration",
    "temperature_c": "Temperature of bath or room",
    "temperature_range_c": "Temperature range stated",
    "corrected": "Corrected",
    "not_corrected": "Not corrected",
    "tolerance_source": "Source of the tolerances",
    "decision_rule": "Decision rule",
}
_UNITS: Final = {"age_at_registration_h": "h", "temperature_c": "°C", "temperature_range_c": "°C"}


def record_facts(registration: Mapping[str, Any]) -> list[Fact]:
    """Return every field of the record, "not stated" where it is missing; none without one."""
    record = mapping(registration, "record")
    if not record:
        return []
    return [_fact(record, key, label) for key, label in _LABELS.items()]


def _fact(record: Mapping[str, Any], key: str, label: str) -> Fact:
    outer, _, inner = key.partition(".")
    value = mapping(record, outer).get(inner) if inner else record.get(outer)
    if key in ("corrected", "not_corrected"):
        return Fact(label, "; ".join(value or []) or "nothing")
    if value is None:
        return Fact(label, NOT_STATED)
    if key == "temperature_range_c":
        return Fact(label, f"{value[0]:g} to {value[1]:g}", "°C")
    return Fact(label, f"{value:g}" if is_number(value) else plain(value), _UNITS.get(key, ""))
