"""Write the HTML page of an evaluated dye video: verdict, pictures, arrivals, vessel table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from design.network import VesselNetwork
from registration.dye import DyeReport
from registration.report.dye_figures import arrival_figure, frame_figure
from registration.report.page_frame import render
from registration.report.svg import inline_figure
from registration.report.tables import Column, Table, make_table

_COLUMNS: Final = (
    Column("vessel", "Vessel", kind="text"),
    Column("patency", "Patency", kind="text"),
    Column("where", "Dye stops", kind="text"),
    Column("seen_share", "Seen", "%", factor=100.0),
    Column("arrives_s", "Enters", "s"),
    Column("predicted_arrives_s", "predicted", "s"),
    Column("leaves_s", "Leaves", "s"),
    Column("predicted_leaves_s", "predicted", "s"),
    Column("transit_s", "Transit", "s"),
    Column("predicted_transit_s", "predicted", "s"),
    Column("late_s", "Late", "s", kind="signed"),
)
_BESIDE: Final = (
    Column("beside_predicted_leaves_s", "Leaves, beside closed", "s"),
    Column("beside_late_s", "Late, beside closed", "s", kind="signed"),
)
_WORST: Final = ("blocked", "not reached", "not seen", "open", "no flow")


def write_dye_html(
    path: Path, title: str, data: Mapping[str, Any], report: DyeReport, network: VesselNetwork
) -> None:
    """Write the page as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    title : str
        The film's name.
    data : dict
        Of `registration.dye.dye_dict`.
    report : DyeReport
    network : VesselNetwork

    Raises
    ------
    OSError
        When the file can't be written.
    """
    context = {
        "title": title,
        "data": data,
        "frame": inline_figure(frame_figure(report, network), "Places over the last frame", "a-"),
        "arrivals": inline_figure(arrival_figure(report), "Arrivals, measured, predicted", "b-"),
        "counts": _counts(data["vessels"]),
        "table": vessel_table(data["vessels"]),
    }
    write_text(path, render("dye.html", context))


def vessel_table(vessels: list[dict[str, Any]]) -> Table:
    """Rows of the vessels, closed ones first."""
    ordered = sorted(vessels, key=lambda v: (_WORST.index(v["patency"]), v["vessel"]))
    rows = [{**v, **_beside(v), "where": _where(v)} for v in ordered]
    beside = _BESIDE if any(v["beside"] for v in vessels) else ()
    return make_table("dye", rows, (*_COLUMNS, *beside), order="closed and unseen ones first")


def _beside(vessel: Mapping[str, Any]) -> dict[str, Any]:
    return {f"beside_{name}": value for name, value in (vessel["beside"] or {}).items()}


def _where(vessel: Mapping[str, Any]) -> str | None:
    if vessel["patency"] != "blocked":
        return None
    if vessel["blocked_from_mm"] is None:
        behind = ", ".join(map(str, vessel["or_in"]))
        return "doesn't enter" + (f"; or closed in {behind}" if behind else "")
    return f"{vessel['blocked_from_mm']:.2f} to {vessel['blocked_to_mm']:.2f} mm"


def _counts(vessels: list[dict[str, Any]]) -> list[tuple[str, int]]:
    counts = [(state, sum(v["patency"] == state for v in vessels)) for state in _WORST]
    return [(state, count) for state, count in counts if count or state in ("blocked", "open")]
