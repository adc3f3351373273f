"""Data class of written ink as straight strands: ends, ink volume, cross-section, stroke."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Strands:
    """Straight pieces that are written, in the order of writing.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Of the tip.
    dose_ul : (n,) float64, µL
    area_mm2 : (n,) float64, mm²
        Cross-section: the dose over the way, or over a window of it.
    stroke : (n,) int64
        Ascending: which unbroken line each is of.
    line : (n,) int64
        Of the file, from 1; of executed motion as `ExecutedMotion.line`.
    """

    start: FloatArray
    end: FloatArray
    dose_ul: FloatArray
    area_mm2: FloatArray
    stroke: IntArray
    line: IntArray

    @staticmethod
    def dosed(
        start: FloatArray, end: FloatArray, dose_ul: FloatArray, stroke: IntArray, line: IntArray
    ) -> Strands:
        """Return strands whose cross-section is each one's own dose over its way, above 0 mm."""
        length = np.linalg.norm(end - start, axis=1)
        return Strands(start, end, dose_ul, dose_ul / length, stroke, line)

    @staticmethod
    def joined(each: Sequence[Strands]) -> Strands:
        """Return those of several heads, one after the other; no two heads share a stroke."""
        past = np.cumsum([0, *(int(one.stroke.max(initial=-1)) + 1 for one in each)])
        own = [replace(one, stroke=one.stroke + k) for one, k in zip(each, past[:-1], strict=True)]
        return Strands(
            *(np.concatenate([getattr(one, item.name) for one in own]) for item in fields(Strands))
        )

    def __len__(self) -> int:
        return len(self.line)

    @property
    def length(self) -> FloatArray:
        """Way of each, (n,), mm."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    @property
    def radius(self) -> FloatArray:
        """Of each as a round filament, (n,), mm."""
        return np.sqrt(4 / np.pi * self.area_mm2) / 2

    @property
    def passes(self) -> int:
        """Number of unbroken lines."""
        return len(np.unique(self.stroke))

    def moved(self, by_mm: FloatArray) -> Strands:
        """Return the same, moved by (3,) mm."""
        return replace(self, start=self.start + by_mm, end=self.end + by_mm)
