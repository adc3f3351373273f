"""Data type of the cross-sections to measure along lumens: position, direction, designed size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class SectionStations:
    """Sections to be measured, lumen after lumen, in the printer's frame.

    Attributes
    ----------
    lumen : (n,) int64
        Ascending.
    axis, along : (n, 3) float64
        A point of the lumen (mm), and the unit vector of its way.
    designed_mm : (n,) float64, mm
        Widest circle of the designed section.
    radius : (n,) float64, mm
        Of the circle of the designed section's area.
    window, limit : (n,) float64, mm
        How far the middle of the open section may lie from the axis, and how far is looked.
    step_mm : (n,) float64, mm
        Length of lumen that the station stands for.
    own : (n,) bool
        Whether the section is this lumen's alone; at a fork it isn't, and what is more open than
        designed there says nothing of this lumen.
    names : tuple of str
        Of each lumen.
    """

    lumen: IntArray
    axis: FloatArray
    along: FloatArray
    designed_mm: FloatArray
    radius: FloatArray
    window: FloatArray
    limit: FloatArray
    step_mm: FloatArray
    own: BoolArray
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.lumen)

    @property
    def count(self) -> int:
        """Number of lumens."""
        return len(self.names)

    @property
    def first(self) -> IntArray:
        """Where each lumen's stations begin, and the end, (count + 1,)."""
        return np.searchsorted(self.lumen, np.arange(self.count + 1)).astype(np.int64)
