"""Convert embedded writing moves to round filaments, their diameter from extruded ink."""

from __future__ import annotations

from typing import Final

import numpy as np

from printctl.checks.lumens.line_widths import check_width, dose_per_mm
from printctl.errors import UsageError
from sim.gcode.deposit.strands import Strands

THREAD_MM: Final = 1e-3
"""Thinner filaments are none."""
PIECE_DIAMETERS: Final = 1.0
LEAST_PIECE_MM: Final = 0.1


def filaments(strokes: Strands, window_mm: float) -> Strands:
    """Strokes as filaments: π d² / 4 is the dose over the way.

    Parameters
    ----------
    strokes : Strands
        Level or not.
    window_mm : float, mm
        Way over which a dose is taken, within its stroke.

    Raises
    ------
    UsageError
        When nothing is written, or the diameters are impossible.
    """
    if not len(strokes.line):
        raise UsageError("no move of the G-code pushes ink on its way; is E, or the valve, in it?")
    length = strokes.length
    area = dose_per_mm(length, strokes.dose_ul, strokes.stroke, window_mm)
    diameter = np.sqrt(4 / np.pi * np.maximum(area, 0.0))
    check_width(diameter, strokes.line)
    kept = diameter > THREAD_MM
    return Strands(
        strokes.start[kept],
        strokes.end[kept],
        strokes.dose_ul[kept],
        area[kept],
        strokes.stroke[kept],
        strokes.line[kept],
    )


def in_short_pieces(strands: Strands) -> Strands:
    """The same in pieces about as long as they are thick, to be found by their middles."""
    length = strands.length
    most = np.maximum(2 * PIECE_DIAMETERS * strands.radius, LEAST_PIECE_MM)
    count = np.maximum(np.ceil(length / most), 1).astype(np.int64)
    of = np.repeat(np.arange(len(strands)), count)
    within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    way = (strands.end - strands.start)[of]
    return Strands(
        strands.start[of] + (within / count[of])[:, None] * way,
        strands.start[of] + ((within + 1) / count[of])[:, None] * way,
        (strands.dose_ul / count)[of],
        strands.area_mm2[of],
        strands.stroke[of],
        strands.line[of],
    )
