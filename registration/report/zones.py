"""Report table of ISO 1101 tolerance zones and decisions, and facts of the reference frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from registration.report.sections import mapping, records
from registration.report.tables import Column, Table, make_table
from registration.report.wording import fixed, is_number, plain

COLUMNS: Final = (
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
    return make_table("zones", rows, COLUMNS, order="by vessel") if rows else None


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
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
