"""Find the middle of a laser's line in each column of a picture."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels import jit

_TOGETHER: Final = 32
"""Columns that are looked at together."""


@jit
def line_middles(
    image: NDArray[Any],
    ground: NDArray[Any],
    gain: float,
    least: float,
    widest: int,
    upright: bool = False,
) -> NDArray[np.float64]:
    """Return the row of the line's middle in each column, (columns,); NaN where lost.

    The middle is the centroid of what lies above half of the peak: a saturated line has a flat top,
    and light scattered below the surface a long foot, which neither moves it.

    Parameters
    ----------
    image, ground : (rows, columns)
        The picture, and the same view without the laser.
    gain : float
        Of the picture's light against the ground's.
    least : float
        Least height of a peak over the ground.
    widest : int, px
        A wider line is lost; a second peak so far from the first is another one.
    upright : bool
        Whether the line runs from top to bottom: rows count as columns, and columns as rows.
    """
    high, wide = image.shape
    rows, columns = (wide, high) if upright else (high, wide)
    share = np.float32(gain)
    # A second peak matters above half of the first: darker places are passed by many at once.
    dark = np.float32(0.49 * least)
    best = np.zeros(columns, np.float32)
    second = np.zeros(columns, np.float32)
    at = np.zeros(columns, np.int64)
    for i in range(high):
        for first in range(0, wide, _TOGETHER):
            last = min(first + _TOGETHER, wide)
            light, view = image[i, first:last], ground[i, first:last]
            bright = 0
            for k in range(last - first):
                bright += int(np.float32(light[k]) - share * np.float32(view[k]) > dark)
            if bright == 0:
                continue
            for j in range(first, last):
                over = np.float32(image[i, j]) - share * np.float32(ground[i, j])
                if over <= dark:
                    continue
                row, column = (j, i) if upright else (i, j)
                if over > best[column]:
                    if row - at[column] > widest:
                        second[column] = max(second[column], best[column])
                    best[column] = over
                    at[column] = row
                elif over > second[column] and row - at[column] > widest:
                    second[column] = over
    middle = np.full(columns, np.nan)
    for column in range(columns):
        if best[column] < least or second[column] > 0.5 * best[column]:
            continue
        half = 0.5 * best[column]
        total, moment, count = 0.0, 0.0, 0
        for way in (-1, 1):
            row = at[column] if way == 1 else at[column] - 1
            while 0 <= row < rows and count <= widest:
                i, j = (column, row) if upright else (row, column)
                over = np.float32(image[i, j]) - share * np.float32(ground[i, j]) - half
                if over <= 0:
                    break
                total += over
                moment += over * row
                count += 1
                row += way
        if count > widest or at[column] < 2 or at[column] > rows - 3:
            continue
        middle[column] = moment / total
    return middle
