"""SVG figures comparing prints: quantities per print, vessel errors, diameter profiles overlaid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kernels.arrays import FloatArray
from registration.comparison import Comparison
from registration.comparison.overall import Quantity
from registration.comparison.vessels import SIGNIFICANT, VesselSpread
from report.drawing import broken_line, small_multiples, styled, to_svg
from report.picture.colours import SEQUENTIAL
from report.svg import ACCENT, INK, MUTED, PAPER

OUTSIDE: Final = "#b85a14"
_LABELLED_IN: Final = (0.8, 0.78)
"""Between panels that each have their own quantity and axis."""
_UNDER_IN: Final = (0.5, 0.78)
"""Between panels that share a row's quantity."""
MOST_PANELS: Final = 12
MOST_ROWS: Final = 60
TITLES: Final = {
    "mean_diameter_error": "Mean diameter error",
    "scale_x": "Scale along x",
    "scale_y": "Scale along y",
    "scale_z": "Scale along z",
    "offset": "Radial offset",
    "rms_deviation": "RMS deviation, scaled fit",
}


def quantities_figure(comparison: Comparison) -> bytes:
    """Each quantity over the prints: scans with their intervals, the mean, a line that drifts."""
    known = [q for q in comparison.quantities if np.isfinite(q.values).any()]
    at = scan_places(comparison)
    with styled():
        figure, grid, _ = small_multiples(len(known), 1.9, _LABELLED_IN)
        for axes, quantity in zip(grid, known, strict=True):
            _quantity(axes, quantity, at)
            _print_axis(axes, len(comparison.prints))
        return to_svg(figure, "quantities")


def scan_places(comparison: Comparison) -> FloatArray:
    """Where each scan stands: at its print's number, from 1, scans of one print side by side."""
    places = [
        k + 1 + 0.14 * (n - (len(each.scans) - 1) / 2)
        for k, each in enumerate(comparison.prints)
        for n in range(len(each.scans))
    ]
    return np.array(places)


def _quantity(axes: Axes, quantity: Quantity, at: FloatArray) -> None:
    values, half = np.array(quantity.values), np.nan_to_num(np.array(quantity.half))
    mean = quantity.parts.mean
    if np.isfinite(mean.low):
        axes.axhspan(mean.low, mean.high, color=ACCENT, alpha=0.10, linewidth=0)
    axes.axhline(mean.value, color=MUTED, linewidth=0.8)
    if quantity.name != "rms_deviation" and _near_zero(values, half):
        axes.axhline(0.0, color=INK, linewidth=0.8, linestyle=(0, (1, 2)))
    axes.errorbar(at, values, half, fmt="o", color=ACCENT, markersize=4.5, linewidth=1.0,
                  markeredgecolor=PAPER, markeredgewidth=0.6)  # fmt: skip
    drift = quantity.per_print
    title = TITLES[quantity.name]
    if drift is not None and quantity.p_drift < SIGNIFICANT:
        last = len(quantity.parts.print_means) - 1
        line = [drift.at_first, drift.at_first + drift.slope.value * last]
        axes.plot([1, last + 1], line, color=OUTSIDE, linewidth=1.1)
        title += ": drifts"
    axes.set_title(title, loc="left", fontsize=8.6, color=INK)
    axes.set_ylabel(quantity.unit)


def _near_zero(values: FloatArray, half: FloatArray) -> bool:
    low, high = np.nanmin(values - half), np.nanmax(values + half)
    reach = max(high - low, 1e-9)
    return bool(low - reach < 0 < high + reach)


def _print_axis(axes: Axes, count: int) -> None:
    axes.set_xlim(0.5, count + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(min(count, 10), integer=True))
    axes.set_xlabel("print")


def vessels_figure(comparison: Comparison) -> bytes | None:
    """Every vessel's mean error with its interval, its prints, and the tolerance."""
    shown = [v for v in comparison.vessels if np.isfinite(v.error.mean.value)]
    if not shown:
        return None
    shown = sorted(ranked(shown)[:MOST_ROWS], key=lambda v: v.vessel)
    at = np.arange(len(shown))
    with styled():
        figure = Figure(figsize=(5.2, 0.9 + 0.2 * len(shown)), layout="constrained")
        axes = figure.add_subplot()
        axes.spines[["top", "right"]].set_visible(False)
        axes.axvline(0.0, color=INK, linewidth=0.8)
        for row, vessel in zip(at, shown, strict=True):
            _row(axes, float(row), vessel, comparison.tolerance_percent)
        axes.set_yticks(at, [str(v.vessel) for v in shown])
        axes.tick_params(axis="y", length=0, labelsize=8)
        axes.set(ylim=(len(shown) - 0.4, -0.6), ylabel="vessel", xlabel="diameter error / µm")
        axes.set_xlim(*_reach(shown, comparison.tolerance_percent))
        return to_svg(figure, "vessels")


def _row(axes: Axes, at: float, vessel: VesselSpread, percent: float | None) -> None:
    mean, colour = vessel.error.mean, OUTSIDE if vessel.off else ACCENT
    if percent is not None:
        limit = vessel.designed_um * percent / 100
        axes.plot([-limit, limit], [at, at], "|", color=MUTED, markersize=9)
    prints = np.array(vessel.error.print_means)
    axes.plot(prints, np.full(len(prints), at), "o", color=MUTED, markersize=2.6, alpha=0.8)
    if np.isfinite(mean.low):
        axes.plot([mean.low, mean.high], [at, at], color=colour, linewidth=1.4)
    axes.plot(mean.value, at, "o", color=colour, markersize=5, markeredgecolor=PAPER,
              markeredgewidth=0.6)  # fmt: skip


def _reach(shown: Sequence[VesselSpread], percent: float | None) -> tuple[float, float]:
    """Wide enough for prints and tolerance; an interval from two prints may leave the drawing."""
    values = np.concatenate([[0.0], *(v.error.print_means for v in shown)])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if percent is not None:
        limit = max(v.designed_um for v in shown) * percent / 100
        low, high = min(low, -limit), max(high, limit)
    room = 0.35 * max(high - low, 1.0)
    return low - room, high + room


def ranked(vessels: Sequence[VesselSpread]) -> list[VesselSpread]:
    """Those that say most first: drifting, varying or off, then the farthest off."""

    def rank(vessel: VesselSpread) -> tuple[bool, float]:
        plain = not (vessel.varies or vessel.p_drift < SIGNIFICANT or vessel.off)
        return plain, -float(np.nanmax(np.abs([0.0, *vessel.error.print_means])))

    return sorted(vessels, key=rank)


def history_figure(comparison: Comparison) -> bytes | None:
    """The vessels that say most, each one's error over the prints."""
    known = [v for v in comparison.vessels if v.error.prints > 1]
    if not known:
        return None
    shown = sorted(ranked(known)[:MOST_PANELS], key=lambda v: v.vessel)
    at = scan_places(comparison)
    error = np.array([scan.error_um for scan in comparison.scans])
    with styled():
        figure, grid, columns = small_multiples(len(shown), 1.9, _UNDER_IN)
        for axes, vessel in zip(grid, shown, strict=True):
            _history(axes, at, error[:, vessel.vessel], vessel, comparison.tolerance_percent)
            _print_axis(axes, len(comparison.prints))
        for axes in grid[::columns]:
            axes.set_ylabel("error / µm")
        return to_svg(figure, "history")


def _history(
    axes: Axes, at: FloatArray, error: FloatArray, vessel: VesselSpread, percent: float | None
) -> None:
    if percent is not None:
        limit = vessel.designed_um * percent / 100
        axes.axhspan(-limit, limit, color=ACCENT, alpha=0.08, linewidth=0)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    if vessel.p_drift < SIGNIFICANT and vessel.drift is not None:
        last = len(vessel.error.print_means) - 1
        start = vessel.drift.at_first
        line = [start, start + vessel.drift.slope.value * last]
        axes.plot([1, last + 1], line, color=OUTSIDE, linewidth=1.0)
    axes.plot(at, error, "o-", color=INK, linewidth=0.7, markersize=3.6)
    words = [name for name, holds in (("off", vessel.off), ("varies", vessel.varies),
             ("drifts", vessel.p_drift < SIGNIFICANT)) if holds]  # fmt: skip
    axes.set_title(f"vessel {vessel.vessel}" + (f": {', '.join(words)}" if words else ""),
                   loc="left", fontsize=8.6, color=OUTSIDE if words else INK)  # fmt: skip


def along_figure(comparison: Comparison) -> bytes | None:
    """Diameter along the vessels that say most, every scan laid over the others."""
    ill = {d.vessel for d in comparison.defects}
    known = [
        v for v in comparison.vessels if any(len(s.sections[v.vessel][0]) for s in comparison.scans)
    ]
    if not known:
        return None
    known = sorted(ranked(known), key=lambda v: v.vessel not in ill)[:MOST_PANELS]
    shown = sorted(known, key=lambda v: v.vessel)
    # From pale to dark by order; the palest of the scale would be lost on paper.
    colours = SEQUENTIAL(np.linspace(0.75, 0.05, len(comparison.prints)))
    with styled():
        figure, grid, columns = small_multiples(len(shown), 1.9, _UNDER_IN)
        for axes, vessel in zip(grid, shown, strict=True):
            axes.axhline(vessel.designed_um, color=MUTED, linewidth=0.8)
            for number, each in enumerate(comparison.prints):
                for k in each.scans:
                    along, diameter = broken_line(*comparison.scans[k].sections[vessel.vessel])
                    # A line through one section can't be seen.
                    few = "." if len(along) < 4 else ""
                    axes.plot(along, diameter, few + "-", color=colours[number], linewidth=0.9,
                              markersize=4)  # fmt: skip
            axes.set_title(f"vessel {vessel.vessel}", loc="left", fontsize=8.6, color=INK)
            axes.set_xlim(0, comparison.scans[0].length_mm[vessel.vessel])
            axes.set_xlabel("along / mm")
        for axes in grid[::columns]:
            axes.set_ylabel("diameter / µm")
        return to_svg(figure, "along")
