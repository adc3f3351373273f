"""Draw a predicted print, finished or at a middle layer, as one PNG."""

from __future__ import annotations

import io
import math
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize, to_rgba
from PIL import Image

from kernels.arrays import FloatArray, IntArray
from registration.gcode_job import Act
from report.drawing import aspect, blank, draw_scaled_lines, set_limits, styled
from report.gcode.colouring import Colouring
from report.picture.colours import SEQUENTIAL
from report.picture.quantity import bar_ends, bar_limits
from report.play.playback import Playback, PlayRows
from report.play.serialise import NOT_HELD, OFF, colourings

_WIDTH_IN: Final = 6.0
_DPI: Final = 130
_TURN: Final = math.radians(30.0)
"""Azimuth and elevation of the look at passes, as the page begins."""


def draw_frame(played: Playback) -> tuple[bytes, str]:
    """Draw the finished print, or of a layered one the layer half-way; a PNG, and what it shows."""
    rows = played.rows
    written = np.flatnonzero((rows.act == Act.WRITE) & ~np.isnan(rows.width_mm))
    if played.passes:
        said = f"All {len(played.layer_z_mm)} passes, seen from an angle"
    else:
        layer = int(rows.layer[written[len(written) // 2]])
        written = written[rows.layer[written] == layer]
        said = f"Layer {layer + 1} of {len(played.layer_z_mm)}, seen from above"
    chosen = colourings(played)[0]
    off = chosen.key == "off"
    values = 100 * played.compared[written] if off else rows.width_mm[written]
    scale = OFF if off else SEQUENTIAL
    name = f"{chosen.name} / {chosen.unit}" if chosen.unit else chosen.name
    return _drawn(played, written, values, chosen, scale, name), f"{said}. {name}."


def _drawn(
    played: Playback,
    written: IntArray,
    values: FloatArray,
    chosen: Colouring,
    scale: Colormap,
    name: str,
) -> bytes:
    start, end, order = _seen(played.rows, written, played.passes)
    ends = np.concatenate([start, end])
    with styled():
        figure, axes = blank(_WIDTH_IN, (0.74 * aspect(np.ptp(ends, axis=0)) + 0.14) * _WIDTH_IN)
        figure.set_dpi(_DPI)
        figure.set_facecolor("white")
        axes.set_aspect("equal")
        axes.set(xlabel="mm", ylabel="mm") if played.passes else axes.set(
            xlabel="x / mm", ylabel="y / mm"
        )
        width = played.rows.width_mm[written]
        set_limits(axes, ends, float(width.max(initial=0.0)) / 2)
        norm = Normalize(*bar_limits(chosen.limits))
        beyond = bar_ends(chosen.limits, chosen.extremes)
        bar = figure.colorbar(
            ScalarMappable(norm, scale), ax=axes, pad=0.02, shrink=0.8, extend=beyond
        )
        if chosen.limits[0] == chosen.limits[1]:
            bar.set_ticks([chosen.limits[0]])
        bar.set_label(name)
        bar.outline.set_visible(False)
        colour = np.where(np.isnan(values)[:, None], to_rgba(NOT_HELD), scale(norm(values)))
        lines = list(np.stack([start, end], axis=1)[order])
        draw_scaled_lines(figure, lines, width[order], colour[order])
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return _png(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))


def _seen(
    rows: PlayRows, written: IntArray, turned: bool
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Ends in the picture's plane, and the order from far to near."""
    start, end = rows.start[written], rows.end[written]
    if not turned:
        return start[:, :2], end[:, :2], np.arange(len(written))
    c, s = math.cos(_TURN), math.sin(_TURN)
    look = np.array([[c, -s * s, s * c], [s, c * s, -c * c], [0.0, c, s]])
    start, end = start @ look, end @ look
    # Places along a slanted look mean nothing, lengths do.
    zero = np.minimum(start.min(axis=0), end.min(axis=0))
    start, end = start - zero, end - zero
    return start[:, :2], end[:, :2], np.argsort(start[:, 2] + end[:, 2], kind="stable")


def _png(drawn: Image.Image) -> bytes:
    stream = io.BytesIO()
    few = drawn.quantize(128, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(stream, format="png", optimize=True)
    return stream.getvalue()
