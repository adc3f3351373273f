"""Shared state of datum fits: current frame and measurement errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors


@dataclass(frozen=True)
class Setting:
    """What all datum features of a scan share.

    Attributes
    ----------
    fit : Fit
        Scan to part, so far.
    errors : ScanErrors
    strains : tuple of (3, 3) float64
        See `frame.strains`.
    """

    fit: Fit
    errors: ScanErrors
    strains: tuple[FloatArray, ...]

    def stretched(self, place: FloatArray) -> list[FloatArray]:
        """Motion (3,) of a place by each stretch."""
        return [strain @ (place - self.fit.centre) for strain in self.strains]


def light_shift(there: Setting) -> float:
    """Standard uncertainty of a lumen's middle along the light, mm.

    The wall above and the one below it face the light otherwise and may err apart: the middle is
    half of the difference of two errors.
    """
    return float(np.hypot(there.errors.level_mm, there.errors.facing_mm) / np.sqrt(2))


def light_across(there: Setting, u: FloatArray, v: FloatArray) -> tuple[float, float]:
    """Return `light_shift` along two unit vectors (3,), mm."""
    beam = there.fit.rotation @ there.errors.beam
    size = light_shift(there)
    return float(size * (beam @ u)), float(size * (beam @ v))
