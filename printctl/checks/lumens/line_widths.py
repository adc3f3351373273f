"""Heights and widths of a layered file's printed lines, from their positions and ink."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from printctl.errors import UsageError
from sim.gcode.reading.comments import plain_lines, read_comments

LEVEL_TOLERANCE_MM: Final = 5e-3
FLAT_MM: Final = 1e-3


def check_level(begin: FloatArray, end: FloatArray, line: IntArray) -> None:
    """Refuse lines (n, 3) that aren't level."""
    tilted = np.flatnonzero(np.abs(end[:, 2] - begin[:, 2]) > FLAT_MM)
    if len(tilted):
        k = tilted[0]
        raise UsageError(
            f"line {line[k]} writes from z {begin[k, 2]:g} to {end[k, 2]:g} mm "
            f"({len(tilted)} such lines): these are no level layers; of an embedded print say "
            "--embedded, a spiral can't be read"
        )


def check_width(width: FloatArray, line: IntArray) -> None:
    """Refuse widths of a wrong unit or bore: every lumen would be wrong with them."""
    middle = float(np.median(width))
    if not 5e-3 <= middle <= 10.0:
        k = int(np.argmin(np.abs(width - middle)))
        raise UsageError(
            f"lines would be {1e3 * middle:.3g} µm wide (median; so line {line[k]}), which is "
            "outside 5 to 10000 µm; check what E means: the syringe or the filament's diameter, "
            "of a pneumatic head its flow"
        )


@dataclass(frozen=True)
class LayerHeightComments:
    """Heights of layers that a file's comments say (``;HEIGHT:0.06``).

    Attributes
    ----------
    line : (h,) int64
        Of each comment, ascending.
    mm : (h,) float64, mm
        From there on.
    """

    line: IntArray
    mm: FloatArray

    def of(self, lines: IntArray) -> FloatArray:
        """What is said of each line of the file, (n,), mm; NaN before the first comment."""
        if not len(self.line):
            return np.full(len(lines), np.nan)
        at = np.searchsorted(self.line, lines) - 1
        return np.where(at >= 0, self.mm[np.maximum(at, 0)], np.nan)


def comment_heights(gcode: bytes) -> LayerHeightComments:
    """Read a file's comments."""
    comments = read_comments(plain_lines(gcode))
    return LayerHeightComments(comments.height_lines, comments.height_mm)


def slabs(
    height: FloatArray, layer_mm: float | None, said_mm: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Slab of each level, and each line's level.

    A slab reaches down to the level below. The lowest, and one that hangs above the last, is as
    thick as ``layer_mm``, as the file says of it, or as the most frequent one.

    Parameters
    ----------
    height : (n,) float64, mm
        Of each line.
    layer_mm : float or None, mm
        What the user says; it counts above what the file says.
    said_mm : (n,) float64 or None, mm
        What the file says of each line; NaN for nothing.
    """
    ordered = np.unique(np.round(height, 4))
    new = np.concatenate([[True], np.diff(ordered) > LEVEL_TOLERANCE_MM])
    high = ordered[new]
    gaps = np.diff(high)
    layer = np.searchsorted(high, height + LEVEL_TOLERANCE_MM, side="right") - 1
    if layer_mm is None and said_mm is not None and not np.isnan(said_mm).any():
        commented = np.array([np.median(own) for own in _of_each(said_mm, layer, len(high))])
        below = np.concatenate([[np.inf], gaps])
        thick = np.where(below > commented + LEVEL_TOLERANCE_MM, commented, below)
        return high - thick, high, layer.astype(np.int64)
    if layer_mm is None and len(gaps) == 0:
        raise UsageError("the G-code has one layer, whose thickness is unknown; give --layer-um")
    if layer_mm is None:
        values, counts = np.unique(np.round(gaps, 3), return_counts=True)
        layer_mm = float(values[counts.argmax()])
    thick = np.concatenate([[layer_mm], np.where(gaps > 1.5 * layer_mm, layer_mm, gaps)])
    return high - thick, high, layer.astype(np.int64)


def _of_each(values: FloatArray, group: IntArray, count: int) -> list[FloatArray]:
    """Values of each group, of which none is empty."""
    order = np.argsort(group, kind="stable")
    return np.split(values[order], np.searchsorted(group[order], np.arange(1, count)))


def dose_per_mm(
    length: FloatArray, dose: FloatArray, stroke: IntArray, window_mm: float
) -> FloatArray:
    """Dose per mm of way, (n,), over ``window_mm`` about each move's middle, within its stroke.

    Parameters
    ----------
    length, dose : (n,) float64
        Of each move, mm and any unit.
    stroke : (n,) int64
        Ascending: which unbroken line each move is of.
    window_mm : float, mm
        A longer move is a window of its own.
    """
    way = np.concatenate([[0.0], np.cumsum(length)])
    dosed = np.concatenate([[0.0], np.cumsum(dose)])
    opens = way[np.searchsorted(stroke, stroke, side="left")]
    shuts = way[np.searchsorted(stroke, stroke, side="right")]
    half = np.maximum(window_mm, length) / 2
    middle = (way[:-1] + way[1:]) / 2
    # A window that leaves its stroke is moved back into it.
    low = np.maximum(np.minimum(middle - half, shuts - 2 * half), opens)
    high = np.minimum(low + 2 * half, shuts)
    doses: FloatArray = (np.interp(high, way, dosed) - np.interp(low, way, dosed)) / (high - low)
    return doses


def dots(dose: FloatArray, stroke: IntArray) -> FloatArray:
    """√(4 V / π) of each move's whole stroke: width of a dot of all its ink, times √thickness.

    A stroke shorter than it is wide is a dot: no line is wider than that.
    """
    dosed = np.concatenate([[0.0], np.cumsum(dose)])
    opens = dosed[np.searchsorted(stroke, stroke, side="left")]
    shuts = dosed[np.searchsorted(stroke, stroke, side="right")]
    widths: FloatArray = np.sqrt(4.0 / np.pi * (shuts - opens))
    return widths
