"""Hydraulic conductance of open channels between painted lines, by their free width.

A channel is flat between two layers' heights and bounded by ink to both sides. Per cross-section
its conductance over the viscosity is that of a duct with sides a > b, g = (1 - 0.63 b/a) a b^3 / 12
(Bruus, Theoretical Microfluidics, 2008, section 3.4.6); sections are in series. Shares no code with
the product.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def free_widths(ink: BoolArray, row: int, pixel_mm: float) -> FloatArray:
    """Free width around a row of a raster in each of its columns, (n,), mm; 0 where ink lies."""
    found = np.zeros(ink.shape[1])
    for column in range(ink.shape[1]):
        if ink[row, column]:
            continue
        below = np.flatnonzero(ink[:row, column][::-1])
        above = np.flatnonzero(ink[row:, column])
        down = int(below[0]) if len(below) else row
        up = int(above[0]) if len(above) else ink.shape[0] - row
        found[column] = (down + up) * pixel_mm
    return found


def conductance(width_mm: FloatArray, height_mm: float) -> float:
    """Conductance of sections in series, mm⁴ over viscosity and length; 0 where one is closed."""
    long, short = np.maximum(width_mm, height_mm), np.minimum(width_mm, height_mm)
    section = (1 - 0.63 * short / long) * long * short**3 / 12
    if (section <= 0).any():
        return 0.0
    return float(1 / np.mean(1 / section))


def channels(
    ink: BoolArray, rows: Sequence[int], columns: slice, height_mm: float, pixel_mm: float
) -> FloatArray:
    """Conductance of the channel along each of ``rows``, over the columns of a slice."""
    part = ink[:, columns]
    return np.array([conductance(free_widths(part, row, pixel_mm), height_mm) for row in rows])
