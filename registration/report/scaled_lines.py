"""Draw lines in matplotlib figures at their true width in mm, to the drawing's scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from kernels.arrays import FloatArray
from registration.report.drawing import lay_out

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
