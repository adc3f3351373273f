"""Plot a head's predicted tip speed, flow and pressure over time, strokes marked (PNG)."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from design.files import write_bytes
from kernels.arrays import FloatArray
from printctl.checks.bead.predict import InkPrediction
from report.drawing import styled
from report.svg import ACCENT, INK, MUTED, RULE

SIZE_IN: Final = (11.0, 6.6)
DPI: Final = 120
MOST_STEPS: Final = 4000
"""More pieces than that don't fit the picture's width; they are told by their means."""
MOST_MARKS: Final = 60
LATE: Final = "#b0578d"


def write_time_line(
    path: Path, prediction: InkPrediction, window_s: tuple[float, float] | None = None
) -> None:
    """Draw one head's prediction.

    Parameters
    ----------
    path : Path
        Ends in ``.png``.
    prediction : InkPrediction
    window_s : (from, to), optional, s
        From the job's first pulse; the whole by default.
    """
    with styled():
        figure = Figure(figsize=SIZE_IN, layout="constrained", facecolor="white")
        axes = figure.subplots(3, 1, sharex=True)
        _draw(list(axes), prediction, window_s)
        kind = "vessels" if prediction.of_vessels else "layers"
        lag = f"lag {prediction.lag.seconds:g} s ({prediction.lag.how})"
        figure.suptitle(
            f"Dry run: {prediction.mounting.ink.name}, {lag}; bands are strokes"
            + ("" if prediction.of_vessels is None else f", numbers {kind}"),
            fontsize=10,
        )
        image = io.BytesIO()
        FigureCanvasAgg(figure).print_figure(
            image, dpi=DPI, format="png", metadata={"Software": None}
        )
    write_bytes(path, image.getvalue())


def _draw(axes: list[Axes], prediction: InkPrediction, window: tuple[float, float] | None) -> None:
    bead, pieces = prediction.bead, prediction.bead.pieces
    time = pieces.time - pieces.time[0]
    low, high = window or (0.0, float(time[-1]))
    edges = _edges(time, low, high)
    way = _binned(time, pieces.length, edges)
    push = _binned(time, pieces.push_ul + pieces.jump_ul, edges)
    out = _binned(time, bead.flow.out_ul, edges)
    pressure = _binned(time, bead.pressure_pa * 1e-3 * pieces.duration, edges)
    _steps(axes[0], way, edges, color=INK, lw=0.9)
    axes[0].set_ylabel("tip, mm/s")
    _steps(axes[1], push, edges, color=MUTED, lw=0.8, label="plunger")
    _steps(axes[1], out, edges, color=LATE, lw=1.1, label="out of the needle")
    axes[1].set_ylabel("flow, µL/s")
    _scaled(axes[1], push, out)
    axes[1].legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2)
    axes[2].set_ylabel("pressure, kPa")
    if np.isnan(pressure).all():
        axes[2].text(
            0.5, 0.5, "not known: no needle named", ha="center", transform=axes[2].transAxes
        )
    else:
        _steps(axes[2], pressure, edges, color=ACCENT, lw=1.0)
    axes[2].set_xlabel("time from the first motion, s")
    for one in axes:
        one.set_xlim(low, high)
        one.grid(axis="y")
        one.spines[["top", "right"]].set_visible(False)
    _mark(axes, prediction, time, low, high)


def _steps(axes: Axes, values: FloatArray, edges: FloatArray, **style: Any) -> None:
    """Draw a value for each stretch between edges; `Axes.stairs` takes a second for thousands."""
    axes.plot(np.repeat(edges, 2)[1:-1], np.repeat(values, 2), **style)


def _edges(time: FloatArray, low: float, high: float) -> FloatArray:
    """Ends of what is drawn as one: pieces, or where they are many, equal times."""
    inside = np.unique(np.clip(time, low, high))
    if 2 <= len(inside) <= MOST_STEPS:
        return inside
    return np.linspace(low, high, MOST_STEPS + 1)


def _binned(time: FloatArray, amount: FloatArray, edges: FloatArray) -> FloatArray:
    """Rate of what adds up over time, in each stretch between edges."""
    total = np.concatenate([[0.0], np.cumsum(amount)])
    return np.diff(np.interp(edges, time, total)) / np.maximum(np.diff(edges), 1e-12)


def _scaled(axes: Axes, push: FloatArray, out: FloatArray) -> None:
    """Show the flow out of the needle; a plunger's short bursts run out of the picture."""
    top = 1.6 * max(float(np.abs(out).max()), 1e-9)
    if np.abs(push).max() > top:
        axes.set_ylim(min(-0.25 * top, 1.1 * float(out.min())), top)
        axes.text(
            0.005, 0.93, f"plunger's bursts reach {push.min():.3g} to {push.max():.3g} µL/s",
            transform=axes.transAxes, va="top", fontsize=8, color=MUTED,
        )  # fmt: skip


def _mark(
    axes: list[Axes], prediction: InkPrediction, time: FloatArray, low: float, high: float
) -> None:
    """Strokes as bands, every other one; what they are for above, where there is room."""
    bead = prediction.bead
    rows = np.flatnonzero(bead.writes)
    if not len(rows):
        return
    begins = np.flatnonzero(np.diff(bead.stroke[rows], prepend=-1))
    first, last = rows[begins], rows[np.append(begins[1:], len(rows)) - 1]
    seen = (time[last + 1] > low) & (time[first] < high)
    first, last = first[seen], last[seen]
    if len(first) > 20 * MOST_MARKS:
        return
    for one in axes:
        _bands(one, time[first[::2]], time[last[::2] + 1])
    for begin, end in zip(first, last, strict=True):
        if len(first) <= MOST_MARKS and prediction.source[begin] >= 0:
            middle = (max(time[begin], low) + min(time[end + 1], high)) / 2
            axes[0].annotate(
                str(prediction.source[begin]), (middle, 1.0), xycoords=("data", "axes fraction"),
                ha="center", va="bottom", fontsize=7.5, color=MUTED,
            )  # fmt: skip


def _bands(axes: Axes, begin: FloatArray, end: FloatArray) -> None:
    """Shade times from the bottom of a picture to its top, all by one artist."""
    low, high = np.zeros_like(begin), np.ones_like(begin)
    corners = np.array([[begin, low], [end, low], [end, high], [begin, high]])
    shades = PolyCollection(
        list(np.moveaxis(corners, 2, 0)),
        transform=axes.get_xaxis_transform(),
        facecolors=RULE, alpha=0.5, linewidths=0, zorder=0,
    )  # fmt: skip
    axes.add_collection(shades, autolim=False)
