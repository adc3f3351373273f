"""Filaments that a G-code file writes into a bath, round, of diameter by extruded ink."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printctl.errors import UsageError
from printctl.lumens.line_widths import check_width, dose_per_mm
from printctl.lumens.strokes import Strokes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

THREAD_MM: Final = 1e-3
"""Thinner filaments are none."""
PIECE_DIAMETERS: Final = 1.0
LEAST_PIECE_MM: Final = 0.1


@dataclass(frozen=True)
class Filaments:
    """Straight pieces of round filament, balls at both ends, printer's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius : (n,) float64, mm
    stroke : (n,) int64
        Which unbroken pass each is of, ascending.
    line : (n,) int64
        Of the file, from 1.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray
    stroke: IntArray
    line: IntArray

    def __len__(self) -> int:
        return len(self.radius)

    @property
    def passes(self) -> int:
        """Number of unbroken passes."""
        return len(np.unique(self.stroke))


def filaments(strokes: Strokes, window_mm: float) -> Filaments:
    """Strokes as filaments: π d² / 4 is the dose over the way.

    Parameters
    ----------
    strokes : Strokes
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
    length = np.linalg.norm(strokes.end - strokes.begin, axis=1)
    area = dose_per_mm(length, strokes.dose_ul, strokes.stroke, window_mm)
    diameter = np.sqrt(4 / np.pi * np.maximum(area, 0.0))
    check_width(diameter, strokes.line)
    kept = diameter > THREAD_MM
    return Filaments(
        strokes.begin[kept],
        strokes.end[kept],
        diameter[kept] / 2,
        strokes.stroke[kept],
        strokes.line[kept],
    )


def in_short_pieces(found: Filaments) -> Filaments:
    """The same in pieces about as long as they are thick, to be found by their middles."""
    length = np.linalg.norm(found.end - found.start, axis=1)
    most = np.maximum(2 * PIECE_DIAMETERS * found.radius, LEAST_PIECE_MM)
    count = np.maximum(np.ceil(length / most), 1).astype(np.int64)
    of = np.repeat(np.arange(len(found)), count)
    within = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    way = (found.end - found.start)[of]
    return Filaments(
        found.start[of] + (within / count[of])[:, None] * way,
        found.start[of] + ((within + 1) / count[of])[:, None] * way,
        found.radius[of],
        found.stroke[of],
        found.line[of],
    )
