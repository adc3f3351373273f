"""SVG figure of a print watched by camera: share of its lines seen with ink, by picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from report.drawing import blank, styled, to_svg
from report.svg import ACCENT, BAD, INK, MUTED


@dataclass(frozen=True)
class LookRow:
    """One look of an observed print.

    Attributes
    ----------
    number : int
        From 1.
    ink : float
        Share of the way that was seen with ink on it, before any mend; NaN where nothing was seen.
    seen : float
        Share of the way written since the look before that could be judged; NaN for no picture.
    mended : bool
        Whether missing ink was written again after it.
    flow : float or None
        Flow factor that was put in force after it; None where it stayed.
    held : bool
        Whether the print was paused or stopped by it, and nothing was written.
    scan : float
        Share of the same way on which the final scan has ink; NaN where it can't tell.
    """

    number: int
    ink: float
    seen: float
    mended: bool = False
    flow: float | None = None
    held: bool = False
    scan: float = math.nan


def look_figure(rows: Sequence[LookRow]) -> bytes:
    """Share of the written way seen with ink, by look; mends, flow corrections and pauses marked.

    Parameters
    ----------
    rows : sequence of LookRow
        One at least, in their order.

    Returns
    -------
    bytes
        SVG.
    """
    number = np.array([row.number for row in rows])
    ink = 100.0 * np.array([row.ink for row in rows])
    seen = 100.0 * np.array([row.seen for row in rows])
    scan = 100.0 * np.array([row.scan for row in rows])
    low = np.nanmin([*ink, *seen, *scan, 100.0])
    floor = low - 0.12 * (100.0 - low) - 2.0
    with styled():
        figure, axes = blank(7.2, 3.1)
        axes.plot(number, seen, color=MUTED, linewidth=0.8, linestyle=":", label="could be judged")
        axes.plot(
            number, ink, color=ACCENT, linewidth=1.1, marker="o", markersize=3.0, label="with ink"
        )
        if np.isfinite(scan).any():
            axes.plot(
                number,
                scan,
                color=INK,
                linewidth=0.9,
                linestyle="--",
                marker="D",
                markersize=3.0,
                label="with ink in the final scan",
            )
        mended = np.array([row.mended for row in rows])
        held = np.array([row.held for row in rows])
        marks: Any = {"linestyle": "", "markersize": 8.0, "markerfacecolor": "none"}
        # What wasn't seen has a place all the same: on the floor.
        place = np.where(np.isfinite(ink), ink, floor)
        if mended.any():
            axes.plot(number[mended], place[mended], "^", color=INK, label="mended", **marks)
        if held.any():
            axes.plot(number[held], place[held], "s", color=BAD, label="paused or stopped", **marks)
        _mark_flows(axes, rows)
        axes.set(xlabel="look", ylabel="share of the written way / %")
        axes.set(xlim=(number[0] - 0.5, number[-1] + 0.5), ylim=(floor, 101.5))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
        return to_svg(figure, "looks")


def _mark_flows(axes: Any, rows: Sequence[LookRow]) -> None:
    """A line from each correction of the flow on, with its factor."""
    label: str | None = "flow corrected, to factor"
    for row in rows:
        if row.flow is None:
            continue
        axes.axvline(row.number, color=MUTED, linewidth=0.7, linestyle="--", label=label)
        label = None
        axes.annotate(
            f"{row.flow:.2f}",
            (row.number, 0.02),
            (2, 0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            color=MUTED,
            fontsize=7.5,
        )
