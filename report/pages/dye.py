"""Write the HTML page of an evaluated dye video, with its figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from design.files import write_text
from design.network import VesselNetwork
from registration.dye import DyeReport
from report.drawing import blank, styled, to_svg
from report.figures.deviation import OUTSIDE
from report.page_frame import render
from report.picture.colours import DIVERGING, NO_DATA
from report.sections.tables import Column, Table, make_table
from report.svg import ACCENT, INK, MUTED, PAPER, inline_figure

_WIDE_PX = 900


def frame_figure(report: DyeReport, network: VesselNetwork) -> bytes:
    """The film's last frame with the places read, coloured by how late dye came; SVG.

    Places without dye are crosses, places not seen small grey dots; closed vessels are named.
    """
    picture = report.traces.last
    late = report.late_held_s()
    known, clear = np.isfinite(late), report.arrivals.clear
    at = report.view.pixels(report.stations.points)
    reach = max(float(np.percentile(np.abs(late[known]), 95)) if known.any() else 0.0, 0.05)
    norm, step = Normalize(-reach, reach), max(1, picture.shape[1] // _WIDE_PX)
    height, width = picture.shape[:2]
    with styled():
        figure, axes = blank(9.0, 9.0 * float(np.clip(height / width, 0.2, 1.1)) + 0.6)
        shown = picture[::step, ::step, ::-1]
        axes.imshow(shown, extent=(-0.5, width - 0.5, height - 0.5, -0.5), alpha=0.75)
        lines = [report.view.pixels(points) for points, _ in network.polylines()]
        axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.5, alpha=0.6))
        rest = ~known & ~clear
        axes.plot(*at[rest].T, ".", color=NO_DATA, markersize=3)
        axes.plot(*at[clear & ~known].T, "x", color=OUTSIDE, markersize=5, markeredgewidth=1.2)
        axes.scatter(at[known, 0], at[known, 1], s=16, c=late[known], cmap=DIVERGING, norm=norm,
                     edgecolors=INK, linewidths=0.3, zorder=3)  # fmt: skip
        for vessel in report.vessels:
            if vessel.patency == "blocked":
                place = at[report.stations.vessel == vessel.vessel].mean(axis=0)
                axes.annotate(
                    f"{vessel.vessel}: blocked", place, (8, 8), textcoords="offset points",
                    color=INK, fontsize=9, bbox={"facecolor": PAPER, "edgecolor": OUTSIDE},
                )  # fmt: skip
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="column / px",
                 ylabel="row / px")  # fmt: skip
        bar = figure.colorbar(ScalarMappable(norm, DIVERGING), ax=axes, pad=0.02, shrink=0.9)
        bar.set_label("arrival, measured less predicted / s")
        bar.outline.set_visible(False)
        return to_svg(figure, "dye-frame")


def arrival_figure(report: DyeReport) -> bytes:
    """Measured against predicted arrival of each place, with the line of agreement; SVG."""
    x, y = report.held_to.time_s, report.arrivals.time_s
    known = np.isfinite(x) & np.isfinite(y)
    start = report.held_to.start_s
    both = np.concatenate([x[known], y[known], [start]])
    line = np.array([min(start, float(both.min())), 1.04 * float(both.max())])
    with styled():
        figure, axes = blank(5.2, 4.2)
        axes.plot(line, line, color=MUTED, linewidth=0.8, label="as predicted")
        axes.errorbar(
            x[known], y[known], 2.0 * report.arrivals.sd_s[known], fmt="o", markersize=4,
            color=ACCENT, markeredgecolor=PAPER, markeredgewidth=0.5, elinewidth=0.6,
            label=f"places, ± 2 deviations ({int(known.sum())})",
        )  # fmt: skip
        axes.axvline(start, color=MUTED, linewidth=0.6, linestyle=":", label="dye at the inlet")
        axes.set(xlabel="predicted arrival / s", ylabel="measured arrival / s")
        axes.legend(loc="upper left")
        return to_svg(figure, "dye-arrivals")


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


def vessel_table(vessels: list[dict[str, object]]) -> Table:
    """Rows of the vessels, closed ones first."""
    ordered = sorted(vessels, key=lambda v: (_WORST.index(v["patency"]), v["vessel"]))
    rows = [{**v, **_beside(v), "where": _where(v)} for v in ordered]
    beside = _BESIDE if any(v["beside"] for v in vessels) else ()
    return make_table("dye", rows, (*_COLUMNS, *beside), order="closed and unseen ones first")


def _beside(vessel: Mapping[str, Any]) -> dict[str, object]:
    return {f"beside_{name}": value for name, value in (vessel["beside"] or {}).items()}


def _where(vessel: Mapping[str, Any]) -> str | None:
    if vessel["patency"] != "blocked":
        return None
    if vessel["blocked_from_mm"] is None:
        behind = ", ".join(map(str, vessel["or_in"]))
        return "doesn't enter" + (f"; or closed in {behind}" if behind else "")
    return f"{vessel['blocked_from_mm']:.2f} to {vessel['blocked_to_mm']:.2f} mm"


def _counts(vessels: list[dict[str, object]]) -> list[tuple[str, int]]:
    counts = [(state, sum(v["patency"] == state for v in vessels)) for state in _WORST]
    return [(state, count) for state, count in counts if count or state in ("blocked", "open")]
