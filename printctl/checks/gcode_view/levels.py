"""Group a G-code job's writing moves into layers by height or slicer comments, else by stroke."""

from __future__ import annotations

from typing import Final

import numpy as np

from gcode.program.read_program import Comments
from kernels.arrays import FloatArray, IntArray
from report.gcode import Layers

LEVEL_MM: Final = 5e-3
"""Written heights closer than this are one level (two steps of a usual z axis)."""
_FLAT_MM: Final = 1e-6
_SLANTED_SHARE: Final = 0.01
"""Of the written way, in a job that still counts as layered."""


def is_flat(start: FloatArray, end: FloatArray) -> bool:
    """Whether all but a hundredth of the written way, (n, 3) each, is horizontal."""
    way = np.linalg.norm(end - start, axis=1)
    slanted = np.abs(end[:, 2] - start[:, 2]) > _FLAT_MM
    return float(way[slanted].sum()) <= _SLANTED_SHARE * float(way.sum())


def split_levels(z: FloatArray) -> tuple[IntArray, FloatArray]:
    """Level of each written height, (n,), and the levels' highest, ascending."""
    order = np.argsort(z, kind="stable")
    new = np.diff(z[order], prepend=-np.inf) > LEVEL_MM
    level = np.empty(len(z), np.int64)
    level[order] = np.cumsum(new) - 1
    return level, z[order][np.append(np.flatnonzero(new)[1:] - 1, len(z) - 1)]


def line_heights(levels: FloatArray, usual_mm: float | None) -> FloatArray:
    """Height of the lines of each level: down to the level below, (k,), mm.

    The lowest, and one that hangs more than two usual spacings above the last, take the usual
    spacing: ``usual_mm``, or the median of all. NaN where that isn't known either.
    """
    gaps = np.diff(levels)
    if usual_mm is None:
        usual_mm = float(np.median(gaps)) if len(gaps) else np.nan
    below = np.concatenate([[np.inf], gaps])
    return np.asarray(np.where(below <= 2.0 * usual_mm, below, usual_mm))


def make_layers(
    z: FloatArray,
    line: IntArray,
    run: IntArray,
    flat: bool,
    comments: Comments,
    layer_mm: float | None,
) -> tuple[IntArray, Layers]:
    """Layer of each written move and the layers.

    Parameters
    ----------
    z, line, run : (n,) float64 mm, int64, int64
        Tip's height, line of the file, and number of the run, of the moves that write, in order.
    flat : bool
        Whether the job is layered by height; else by the slicer's comments where there are some,
        else by runs.
    comments : Comments
    layer_mm : float or None, mm
        Height of the lines, as the user says.
    """
    if flat:
        level, top = split_levels(z)
        return level, Layers(False, top, _said_heights(level, line, top, comments, layer_mm))
    if len(comments.layer_lines) > 1:
        at = np.searchsorted(comments.layer_lines, line)
        level = np.unique(at, return_inverse=True)[1].astype(np.int64)
        top = _highest(level, z)
        return level, Layers(False, top, _said_heights(level, line, top, comments, layer_mm))
    top = _highest(run, z)
    return run, Layers(True, top, np.full(len(top), np.nan))


def _highest(group: IntArray, z: FloatArray) -> FloatArray:
    top = np.full(int(group.max()) + 1, -np.inf)
    np.maximum.at(top, group, z)
    return top


def _said_heights(
    level: IntArray, line: IntArray, top: FloatArray, comments: Comments, layer_mm: float | None
) -> FloatArray:
    """Heights as the user or the slicer says, else from the levels."""
    heights = line_heights(top, layer_mm)
    if layer_mm is not None or not len(comments.height_lines):
        return heights
    first = np.unique(level, return_index=True)[1]
    at = np.searchsorted(comments.height_lines, line[first]) - 1
    return np.asarray(np.where(at >= 0, comments.height_mm[np.maximum(at, 0)], heights))


def fill_rows(values: IntArray, rows: IntArray, count: int) -> IntArray:
    """Values of some rows for all: a row between takes the next one's, the tail the last one's."""
    at = np.searchsorted(rows, np.arange(count))
    return np.asarray(values[np.minimum(at, len(rows) - 1)])
