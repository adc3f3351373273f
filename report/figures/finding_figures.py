"""Figures of each defect found: raw B-scan and section, with designed and found contours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from registration.json_ready import Record, is_number
from registration.measuring.judging import list_findings
from report.drawing import styled, to_svg
from report.sections.facts import mapping, records
from report.svg import MUTED
from report.views import FindingView, SectionStack, Views
from report.views.findings import Panel
from report.views.mesh_cut import join_lines

DESIGN: Final = "#36b3ec"
MEASURED: Final = "#ff9a1f"
"""Both light enough for dark voxels and dark enough for bright ones."""
_HIGH_IN: Final = 2.3
_WIDE_IN: Final = 8.9
_AROUND: Final = {"left": 0.7, "right": 0.25, "top": 0.3, "bottom": 0.75, "between": 0.75}
"""Inch."""
_TITLE_IN: Final = 2.5
"""Inch; the longest title."""


def finding_figures(
    numbers: Record, views: Views | None, given: Mapping[str, bytes]
) -> dict[str, bytes]:
    """Draw each finding that has pictures and isn't `given`, named ``findings/caption``.

    Parameters
    ----------
    numbers : dict
        Of a judged registration.
    views : Views or None
    given : mapping of str to bytes
        Drawings by name.
    """
    if views is None:
        return {}
    findings, vessels = list_findings(numbers), records(numbers, "vessels")
    made: dict[str, bytes] = {}
    for view in views.findings:
        record = findings[view.finding]
        name = f"findings/{caption(view.finding, record)}"
        made[name] = given.get(name) or _figure(
            view, views.sections, vessels[int(record["vessel"])]
        )
    return made


def caption(number: int, finding: Record) -> str:
    """Say which finding it is: number in the table, vessel, kind, decision, places."""
    place = mapping(finding, "scan_place")
    point = finding.get("point_mm") or []
    said = [
        f"Finding {number + 1}: vessel {finding['vessel']}, {finding['kind']}",
        f"{finding['decision']}" if finding.get("decision") else "",
        f"{finding['at_mm']:.2f} mm along",
        "at x, y, z " + ", ".join(f"{v:.2f}" for v in point) + " mm of the part" if point else "",
        f"B-scan {place['b_scan']}, A-scan {place['a_scan']}, voxel {place['depth']} of depth"
        if place
        else "",
    ]
    return ", ".join(words for words in said if words)


def views_note(views: Views) -> str:
    """Say what the pictures are, and how many there are."""
    grey = "the root of the signal (amplitude)" if views.root else "the scan's own values"
    raw = (
        "the scan's own voxels, nothing filtered"
        if views.raw
        else "the scan's voxels after it was laid out anew for beam or refraction, nothing filtered"
    )
    few = len(views.findings) < views.finding_count
    count = f" {len(views.findings)} of {views.finding_count} findings are shown." if few else ""
    return (
        f"Pictures: {raw}; grey is {grey}, the same shades in all pictures. Blue, dashed: the "
        "design's contour at the fitted pose (in B-scans at the fitted scales, across a vessel as "
        "designed). Orange: the measured contour, in B-scans the segmented surface, across a "
        "vessel the outline whose circle of equal area has the reported diameter (blur and walls "
        f"corrected). Light comes from above.{count}"
    )


def _figure(view: FindingView, stack: SectionStack, vessel: Record) -> bytes:
    panels = [view.b_scan, view.reslice]
    ratios = [abs((p.extent_mm[1] - p.extent_mm[0]) / (p.extent_mm[2] - p.extent_mm[3]))
              for p in panels]  # fmt: skip
    ratios += [1.0] if view.section is not None else []
    with styled():
        figure, axes = _laid_out(ratios)
        for each, shown in zip(axes, panels, strict=False):
            _panel(each, shown)
        axes[0].set(xlabel="x / mm", ylabel="depth / mm")
        axes[1].set_xlabel("y / mm")
        if view.section is not None:
            _across(axes[-1], stack, view.section, vessel)
        _legend(figure)
        return to_svg(figure, f"finding {view.finding}")


def _laid_out(ratios: list[float]) -> tuple[Figure, list[Axes]]:
    """Axes of one height side by side, each as wide as its picture asks for, all that fit."""
    a = _AROUND
    spare = _WIDE_IN - a["left"] - a["right"] - a["between"] * (len(ratios) - 1)
    high = min(_HIGH_IN, spare / sum(ratios))
    whole = high + a["top"] + a["bottom"]
    wide = a["left"] + a["right"] + a["between"] * (len(ratios) - 1) + high * sum(ratios)
    # The last title has no neighbour whose margin it could run into.
    wide += max(0.0, _TITLE_IN - high * ratios[-1] - a["right"])
    figure, at, axes = Figure(figsize=(wide, whole)), a["left"], []
    for ratio in ratios:
        box = (at / wide, a["bottom"] / whole, high * ratio / wide, high / whole)
        axes.append(figure.add_axes(box))
        at += high * ratio + a["between"]
    return figure, axes


def _panel(axes: Axes, shown: Panel) -> None:
    axes.imshow(shown.grey, cmap="gray", vmin=0, vmax=255, extent=shown.extent_mm,
                interpolation="none", aspect="auto")  # fmt: skip
    for lines, colour, style in (
        (shown.measured, MEASURED, "solid"),
        (shown.design, DESIGN, (0, (4, 2.5))),
    ):
        chains = [np.round(chain, 4) for chain in join_lines(lines)]
        axes.add_collection(
            LineCollection(chains, colors=colour, linewidths=1.1, linestyles=[style])
        )
    left, right, bottom, top = shown.extent_mm
    axes.set(xlim=(left, right), ylim=(bottom, top))
    _cross(axes, shown.mark_mm)
    axes.set_title(shown.title, loc="left", fontsize=8.6)


def _cross(axes: Axes, mark: tuple[float, float]) -> None:
    """Mark the finding at the frame, so that nothing of it is covered."""
    axes.plot([mark[0]], [1.0], "v", transform=axes.get_xaxis_transform(), clip_on=False,
              color=MUTED, markersize=5, markeredgewidth=0)  # fmt: skip
    axes.plot([1.0], [mark[1]], "<", transform=axes.get_yaxis_transform(), clip_on=False,
              color=MUTED, markersize=5, markeredgewidth=0)  # fmt: skip


def _across(axes: Axes, stack: SectionStack, section: int, vessel: Record) -> None:
    half, index = 1e3 * float(stack.half[section]), int(stack.index[section])
    axes.imshow(stack.grey[section], cmap="gray", vmin=0, vmax=255,
                extent=(-half, half, half, -half), interpolation="none",
                aspect="auto")  # fmt: skip
    angle = np.linspace(0, 2 * np.pi, 97)
    wall = 1e3 * stack.wall[section]
    radius = 1e3 * float(stack.radius[section])
    axes.plot(*np.append(wall, wall[:1], axis=0).T, color=MEASURED, linewidth=1.1)
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=DESIGN, linewidth=1.1,
              dashes=(4, 2.5))  # fmt: skip
    axes.set(xlim=(-half, half), ylim=(half, -half), xlabel="from the designed axis / µm")
    axes.set_title(_measured(vessel, index), loc="left", fontsize=8.6)


def _measured(vessel: Record, index: int) -> str:
    """Diameter of a section with its interval and the designed one."""
    value, half = vessel["diameter_um"][index], vessel["interval_95_um"][index]
    designed = vessel["designed_along_um"][index]
    said = "closed" if value == 0 else f"{value:.0f}" if is_number(value) else "not known"
    sure = f" ± {half:.0f}" if is_number(half) and value else ""
    return f"at {vessel['along_mm'][index]:.2f} mm: {said}{sure} of {designed:.0f} µm"


def _legend(figure: Figure) -> None:
    handles = [
        Line2D([], [], color=DESIGN, linewidth=1.4, dashes=(4, 2.5), label="design"),
        Line2D([], [], color=MEASURED, linewidth=1.4, label="measured"),
        Line2D([], [], color=MUTED, marker="v", linestyle="none", markersize=5,
               markeredgewidth=0, label="the finding's place"),
    ]  # fmt: skip
    figure.legend(handles=handles, loc="lower left", ncols=3, bbox_to_anchor=(0.0, -0.01))
