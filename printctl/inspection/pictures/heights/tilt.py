"""Remove a profiler's tilt and bow, measured on the bare surface.

A stage that isn't level and a guide that isn't straight raise plate and ink alike, by more than a
layer over a part's length. On a plate its surface shows them; on older layers the correction is
kept where the layer's own lines become flatter (a dish that isn't level tilts its floor alone).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.pictures.heights.height import HeightFrame
from printctl.inspection.pictures.picture import draw_lines
from printctl.inspection.values import ExpectedLines, FloatImage

_MAX_POINTS: Final = 40_000
"""Number of bare cells used for the fit, about."""
_MIN_POINTS: Final = 400
"""Least number of bare cells."""
_ITERATIONS: Final = 6
_OUTLIER_SPREADS: Final = 3.0
"""Standard deviations beyond which a height isn't of the bare surface."""
_MAX_SCATTER_THICKNESSES: Final = 0.25
"""Largest scatter of a bare surface around its tilt and bow, in thicknesses."""
BARE_WIDTHS: Final = 1.7
"""Width of the band around a line's middle beyond which the surface is bare of its foot."""
_MARGIN_CELLS: Final = 4.0
"""Cells added to that band for the profiler's shadow."""


def remove_tilt(
    above: FloatImage, frame: HeightFrame, thickness_mm: float, lines: ExpectedLines
) -> FloatImage:
    """Remove tilt and bow, keeping heights in the middle of fresh lines.

    Parameters
    ----------
    above : (rows, columns) float32, mm
        NaN where not measured.
    frame : HeightFrame
    thickness_mm : float, mm
    lines : ExpectedLines
    """
    surface = _bare_surface(above, frame, thickness_mm, lines)
    if surface is None:
        return above
    at = _places(above, frame, lines)
    if not at.any():
        return above
    flat = np.asarray(above - (surface - np.median(surface[at])), dtype=np.float32)
    better = _spread(flat[at]) < _spread(above[at])
    return flat if better or lines.fresh.all() else above


def _bare_surface(
    above: FloatImage, frame: HeightFrame, thickness_mm: float, lines: ExpectedLines
) -> FloatImage | None:
    """Fit a surface of second order beside all lines; None where it scatters too much."""
    ends = np.stack([frame.to_pixels(lines.start), frame.to_pixels(lines.end)], axis=1)
    px = float(np.hypot(*frame.matrix[:2, 0]) * np.hypot(*frame.matrix[:2, 1])) ** 0.5
    taken = draw_lines(above.shape, ends, BARE_WIDTHS * lines.width_mm * px + _MARGIN_CELLS) > 0
    row, column = np.nonzero(~taken & np.isfinite(above))
    step = max(1, len(row) // _MAX_POINTS)
    row, column = row[::step], column[::step]
    if len(row) < _MIN_POINTS:
        return None
    x, y = _scaled(column, above.shape[1]), _scaled(row, above.shape[0])
    z, basis = above[row, column].astype(np.float64), _basis(x, y)
    near = np.ones(len(z), dtype=np.bool_)
    for _ in range(_ITERATIONS):
        best = np.asarray(np.linalg.lstsq(basis[near], z[near], rcond=1e-6)[0], dtype=np.float64)
        off = np.abs(z - basis @ best)
        spread = 1.4826 * float(np.median(off)) + 1e-9
        near = off < _OUTLIER_SPREADS * spread
    if spread > _MAX_SCATTER_THICKNESSES * thickness_mm:
        return None
    x, y = (_scaled(np.arange(count), count) for count in above.shape[::-1])
    one, by_x, by_y, by_xx, by_xy, by_yy = best
    across = one + by_x * x + by_xx * x * x
    down = by_y * y + by_yy * y * y
    return np.asarray(across + down[:, None] + by_xy * np.outer(y, x), dtype=np.float32)


def _scaled(place: IntArray, count: int) -> FloatArray:
    return np.asarray(2.0 * place / count - 1.0, dtype=np.float64)


def _basis(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return terms up to the second order at places, (n, 6)."""
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def _places(above: FloatImage, frame: HeightFrame, lines: ExpectedLines) -> BoolArray:
    """Return measured cells in the middle of fresh lines, (rows, columns)."""
    fresh = lines.fresh
    ends = np.stack([frame.to_pixels(one[fresh]) for one in (lines.start, lines.end)], axis=1)
    core = draw_lines(above.shape, ends, np.ones(int(fresh.sum())))
    return np.asarray((core > 0) & np.isfinite(above))


def _spread(values: FloatImage) -> float:
    """Return the range of heights from percentile 33 to 84, insensitive to missing ink."""
    low, high = np.percentile(values, [33, 84])
    return float(high - low)
