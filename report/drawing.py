"""Blank matplotlib figures in the report's style, lines at true width, as SVG or PNG."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from kernels.arrays import FloatArray
from report.svg import INK, MUTED, PAPER, RULE

PANEL_IN: Final = 3.4
MOST_COLUMNS: Final = 3
_TITLE_IN: Final = 0.25
STYLE: Final[dict[str, object]] = {
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 9.2,
    # A vessel named "$x_2$" is a name, not a formula.
    "text.parse_math": False,
    "axes.unicode_minus": True,
    "text.color": INK,
    "axes.labelcolor": MUTED,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "grid.color": RULE,
    "grid.linewidth": 0.7,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "savefig.facecolor": "none",
    "savefig.edgecolor": "none",
    "patch.edgecolor": PAPER,
}


def styled() -> Any:
    """Context in which a drawing is made and written; leaves the user's settings alone."""
    return rc_context(STYLE)


def blank(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    """A drawing with one open pair of axes."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def small_multiples(
    count: int, height_in: float = 1.75, gap_in: tuple[float, float] = (0.5, 0.56)
) -> tuple[Figure, list[Axes], int]:
    """Open axes for so many panels, row by row, and how many stand in a row.

    Margins are fixed: to have matplotlib look for them took longer than the drawing.

    Parameters
    ----------
    count : int
    height_in : float, inch
        Of a row.
    gap_in : (across, up) float, inch
        Between axes, for what stands there: numbers, titles, and labels where each panel has one.
    """
    columns = min(count, MOST_COLUMNS)
    rows = -(-count // columns)
    wide, high = PANEL_IN * columns, height_in * rows + _TITLE_IN
    left, right, bottom = 0.7, 0.12, 0.5
    across = (wide - left - right - (columns - 1) * gap_in[0]) / columns
    up = (high - bottom - _TITLE_IN - (rows - 1) * gap_in[1]) / rows
    room = {"left": left / wide, "right": 1 - right / wide}
    room |= {"bottom": bottom / high, "top": 1 - _TITLE_IN / high}
    room |= {"wspace": gap_in[0] / across, "hspace": gap_in[1] / up}
    figure = Figure(figsize=(wide, high))
    every = figure.subplots(rows, columns, squeeze=False, gridspec_kw=room).ravel().tolist()
    for axes in every[count:]:
        axes.set_axis_off()
    for axes in every[:count]:
        axes.spines[["top", "right"]].set_visible(False)
    return figure, every[:count], columns


def broken_line(along: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line along a vessel that breaks where a section is missing."""
    if len(along) < 3:
        return along, values
    steps = np.diff(along)
    gaps = 1 + np.flatnonzero(steps > 1.5 * np.median(steps))
    return np.insert(along, gaps, np.nan), np.insert(values, gaps, np.nan)


def lay_out(figure: Figure) -> None:
    """Place a figure's axes, once and for all.

    Left to itself matplotlib does it anew each time it draws, and draws all of a figure a first
    time before it writes it.
    """
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


def to_svg(figure: Figure, salt: str) -> bytes:
    """The drawing as SVG; the same drawing gives the same bytes."""
    stream = io.BytesIO()
    lay_out(figure)
    with rc_context({"svg.hashsalt": salt}), warnings.catch_warnings():
        # The browser has its own fonts: a glyph missing here isn't missing there.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, dpi=150)
    return stream.getvalue()


def to_png(figure: Figure, dpi: float, palette: bool) -> bytes:
    """The drawing as PNG, in 256 colours where `palette` says so."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    if palette:
        drawn = drawn.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    stream = io.BytesIO()
    drawn.save(stream, format="png", optimize=True, dpi=(dpi, dpi))
    return stream.getvalue()


VECTOR_PIECES: Final = 4000
"""Drawings with more lines than this hold them as an embedded picture."""
HAIR_PT: Final = 0.4


def draw_scaled_lines(
    figure: Figure, lines: Sequence[FloatArray], width_mm: FloatArray, colour: Any
) -> None:
    """Draw polylines (k, 2) mm of width (n,) mm, never thinner than a hair.

    The figure's only axes (and colour bar) must have their limits and labels already: the
    width is worked out from where the layout puts them.
    """
    lay_out(figure)
    axes = figure.axes[0]
    axes.apply_aspect()
    collection = LineCollection(lines, capstyle="round", joinstyle="round")
    axes.add_collection(collection, autolim=False)
    pixels = axes.transData.transform([[0.0, 0.0], [1.0, 0.0]])[:, 0]
    points_per_mm = 72.0 / figure.dpi * float(pixels[1] - pixels[0])
    collection.set_linewidth(np.maximum(width_mm * points_per_mm, HAIR_PT).tolist())
    collection.set_color(colour)
    collection.set_rasterized(len(lines) > VECTOR_PIECES)


def set_limits(axes: Axes, points: FloatArray, margin_mm: float) -> None:
    """Let the axes hold ``points`` (n, 2) mm and a margin about them."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = margin_mm + 0.01 * float((high - low).max())
    # A single point, or none, still gets axes.
    margin = margin or 0.5
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)


def aspect(extent: FloatArray) -> float:
    """Height over width of a drawing that holds ``extent`` (2,) mm, within reason."""
    return float(np.clip(extent[1] / max(float(extent[0]), 1e-9), 0.2, 1.2))
