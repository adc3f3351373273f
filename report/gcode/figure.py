"""Draw one G-code layer to scale from above: PNG for a paper, SVG for the report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.colors import Normalize, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from registration.gcode_job import Act, GcodeJob
from report.drawing import (
    VECTOR_PIECES,
    aspect,
    blank,
    set_limits,
    styled,
    to_png,
    to_svg,
)
from report.gcode.bands import band_outlines
from report.gcode.colouring import PLAIN, Colouring
from report.gcode.outline_pack import SCALE_UM
from report.gcode.part_outline import DesignOutline
from report.picture.colours import DIVERGING, NO_DATA, SEQUENTIAL
from report.picture.quantity import bar_ends, bar_limits
from report.svg import MUTED
from report.wording import number

LIFTED: Final = "#b0578d"
_WAYS: Final = (
    (Act.TRAVEL, "travel", MUTED, "solid"),
    (Act.LIFTED, "lifted travel", LIFTED, (0, (3, 2))),
)
_BINS: Final = 48
_WIDTH_IN: Final = 7.0
REPORT_IN: Final = 5.2
_AXES_SHARE: Final = 0.70
"""Of the picture's width; what stands above and below the axes takes `_REST_SHARE` of it."""
_REST_SHARE: Final = 0.1924
_ALPHA: Final = 0.8
_HAIR_MM: Final = 0.02
_LEGEND_AT_MOST: Final = 9
_RIM: Final = "#1c2126"


def draw_layer(
    job: GcodeJob,
    layer: int,
    colouring: Colouring,
    width_px: int,
    palette: bool,
    outline: DesignOutline | None = None,
) -> bytes:
    """Draw one layer, or a pass with those before it, from above; a PNG.

    Parameters
    ----------
    job : GcodeJob
    layer : int
        From 0.
    colouring : Colouring
    width_px : int
        The picture is as high as the layer needs: of a square one 928 for each 1,040.
    palette : bool
        Keep to 256 colours.
    outline : DesignOutline, optional
        Drawn over pale lines, coloured by how far ink lies beyond it; with seams as dots.
    """
    # Letters keep their share of the picture, whatever its width.
    dpi = width_px / _WIDTH_IN
    with styled():
        drawn = _figure(job, layer, colouring, _WIDTH_IN, _title, dpi, outline)
        drawn.set_facecolor("white")
        return to_png(drawn, dpi, palette)


def layer_figure(
    job: GcodeJob, layer: int, colouring: Colouring, outline: DesignOutline | None = None
) -> bytes:
    """The same picture for a page: an SVG without ground and title, `REPORT_IN` wide.

    A layer of more outlines than `VECTOR_PIECES` holds its lines as an embedded picture.
    """
    with styled():
        drawn = _figure(job, layer, colouring, REPORT_IN, None, None, outline)
        axes = drawn.axes[0]
        pieces = sum(len(lines.get_paths()) for lines in axes.collections)
        for lines in axes.collections:
            lines.set_rasterized(pieces > VECTOR_PIECES)
        return to_svg(drawn, "layer")


def _figure(
    job: GcodeJob,
    layer: int,
    colouring: Colouring,
    width_in: float,
    title: Callable[[GcodeJob, int, IntArray], str] | None,
    dpi: float | None,
    outline: DesignOutline | None = None,
) -> Figure:
    """Axes in mm with the layer's lines to scale and its ways; in whole pixels of ``dpi``."""
    here = job.layer <= layer if job.layers.passes else job.layer == layer
    written = np.flatnonzero(here & job.writes)
    ends = np.concatenate([job.start[written, :2], job.end[written, :2]])
    height = (_AXES_SHARE * aspect(np.ptp(ends, axis=0)) + _REST_SHARE) * width_in
    figure, axes = blank(width_in, height if dpi is None else round(height * dpi) / dpi)
    if dpi is not None:
        figure.set_dpi(dpi)
    axes.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
    if title is not None:
        axes.set_title(title(job, layer, written), fontsize=9.2, loc="left", color=MUTED)
    set_limits(axes, ends, float(np.nanmax(job.width_mm[written], initial=0.0)) / 2)
    shown = colouring if outline is None else PLAIN
    _draw_lines(axes, job, written, shown)
    _draw_ways(axes, job, np.flatnonzero(here & ~job.writes))
    handles = _way_handles()
    if outline is None:
        handles = _explain(figure, axes, job, written, colouring) + handles
    else:
        handles += [_draw_outline(figure, axes, outline), _draw_seams(axes, job, written)]
    figure.legend(handles=handles, loc="outside lower left", ncols=5, frameon=False)
    return figure


def _title(job: GcodeJob, layer: int, written: IntArray) -> str:
    volume = float(job.dose_ul[written].sum())
    noun = "Passes 1 to" if job.layers.passes else "Layer"
    parts = [f"{noun} {layer + 1} of {len(job.layers)}"]
    if not job.layers.passes:
        parts.append(f"tip at z = {job.layers.z_mm[layer]:.3f} mm")
    parts.append(f"{number(float(job.way_mm[written].sum()), 4)} mm written")
    return ", ".join([*parts, *([f"{number(volume, 4)} µL"] if np.isfinite(volume) else [])])


def quantity(job: GcodeJob, rows: IntArray, key: str) -> FloatArray:
    """Number that each row is coloured by; NaN where there is none."""
    if key == "line":
        return np.zeros(len(rows))
    if key == "order":
        return np.linspace(0.0, 1.0, max(len(rows), 2))[: len(rows)]
    if key == "height":
        return np.asarray((job.start[rows, 2] + job.end[rows, 2]) / 2)
    if key == "speed":
        return job.speed_mm_s[rows]
    if key == "width":
        return job.width_mm[rows]
    named = job.kind if key == "kind" or job.vessel is None else job.vessel
    return np.where(named[rows] >= 0, named[rows], np.nan).astype(np.float64)


def _draw_lines(axes: Axes, job: GcodeJob, rows: IntArray, colouring: Colouring) -> None:
    values = quantity(job, rows, colouring.key)
    bins, colours = _binned(values, colouring)
    width = np.nan_to_num(job.width_mm[rows], nan=_HAIR_MM)
    run = np.cumsum(np.diff(rows, prepend=-2) != 1)
    start, end = job.start[rows, :2], job.end[rows, :2]
    outlines, of = band_outlines(start, end, width, run, bins)
    axes.add_collection(
        PathCollection(
            outlines, facecolors=colours[of], alpha=_ALPHA, edgecolors="white", linewidths=0.0
        ),
        autolim=False,
    )


def _binned(values: FloatArray, colouring: Colouring) -> tuple[IntArray, NDArray[Any]]:
    """Number of each value's colour, and the colours, (b, 4); the last is that of no value."""
    none = to_rgba(NO_DATA)
    if colouring.colours:
        count = len(colouring.colours)
        bins = np.where(np.isnan(values), count, np.nan_to_num(values) % count)
        return bins.astype(np.int64), np.array([*map(to_rgba, colouring.colours), none])
    low, high = colouring.limits
    share = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)
    bins = np.where(np.isnan(share), _BINS, np.nan_to_num(share) * (_BINS - 1)).astype(np.int64)
    return bins, np.vstack([SEQUENTIAL(np.linspace(0.0, 1.0, _BINS)), none])


def _draw_ways(axes: Axes, job: GcodeJob, rows: IntArray) -> None:
    for act, _, colour, dashes in _WAYS:
        ways = rows[job.act[rows] == act]
        pieces = np.stack([job.start[ways, :2], job.end[ways, :2]], axis=1)
        axes.add_collection(
            LineCollection(list(pieces), colors=colour, linewidths=0.45, linestyles=[dashes]),
            autolim=False,
        )


def _draw_outline(figure: Figure, axes: Axes, outline: DesignOutline) -> Artist:
    """The design's outline, blue where ink falls short of it, orange where it lies beyond."""
    thin = 1.0 if figure.get_figwidth() > REPORT_IN else 0.6
    pieces = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in outline.rings]
    rim = LineCollection(list(outline.rings), colors=_RIM, linewidths=2.8 * thin, zorder=3)
    axes.add_collection(rim, autolim=False)
    drawn = LineCollection(
        list(np.concatenate(pieces)), cmap=DIVERGING, norm=Normalize(-SCALE_UM, SCALE_UM),
        linewidths=1.9 * thin, zorder=4,
    )  # fmt: skip
    drawn.set_array(1e3 * np.concatenate(outline.beyond_mm))
    axes.add_collection(drawn, autolim=False)
    bar = figure.colorbar(drawn, ax=axes, pad=0.02, shrink=0.8, extend="both")
    bar.set_label("Ink beyond design / µm")
    bar.outline.set_visible(False)
    return Line2D([], [], color=_RIM, linewidth=2.4, label="design")


def _draw_seams(axes: Axes, job: GcodeJob, rows: IntArray) -> Artist:
    """A dot where each closed line begins and ends."""
    first = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
    last = np.append(first[1:], len(rows)) - 1
    gap = np.linalg.norm(job.start[rows[first], :2] - job.end[rows[last], :2], axis=1)
    closed = (gap <= np.nan_to_num(job.width_mm[rows[first]])) & (last > first + 1)
    at = job.start[rows[first[closed]], :2]
    (dots,) = axes.plot(
        *at.T, ".", color=_RIM, markersize=3.5, markeredgewidth=0.0, zorder=5, label="seam"
    )
    return dots


def _way_handles() -> list[Artist]:
    return [
        Line2D([], [], color=colour, linewidth=0.8, linestyle=dashes, label=label)
        for _, label, colour, dashes in _WAYS
    ]


def _explain(
    figure: Figure, axes: Axes, job: GcodeJob, rows: IntArray, colouring: Colouring
) -> list[Artist]:
    """A colour bar, or what goes into the legend."""
    if colouring.colours:
        there = np.unique(job.kind[rows][job.kind[rows] >= 0])[:_LEGEND_AT_MOST]
        named = there if colouring.labels else ()  # vessels have colours alone
        return [Patch(color=colouring.colours[k], label=colouring.labels[k]) for k in named]
    bar = figure.colorbar(
        ScalarMappable(Normalize(*bar_limits(colouring.limits)), SEQUENTIAL), ax=axes, pad=0.02,
        shrink=0.8, extend=bar_ends(colouring.limits, colouring.extremes),
    )  # fmt: skip
    unit = f" / {colouring.unit}" if colouring.unit else ""
    if colouring.limits[0] == colouring.limits[1]:
        bar.set_ticks([colouring.limits[0]])
    bar.set_label(colouring.name + (unit or ", first to last"))
    bar.outline.set_visible(False)
    return []
