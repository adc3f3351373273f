"""Compute printed line widths from extruded volume per length."""

from __future__ import annotations

import math

import numpy as np

from firmware_profiles.bead import BeadSection
from kernels.arrays import BoolArray, FloatArray


def cross_sections(
    way: FloatArray, dose: FloatArray, begins: BoolArray, window: float
) -> FloatArray:
    """Cross-section of each written move, mm², as the mean over at least ``window`` mm of its run.

    Parameters
    ----------
    way, dose : (n,) float64, mm and µL
        Of the moves that write, in order.
    begins : (n,) bool
        Where a new run begins.
    window : float, mm
        Shortened at the ends of a run.
    """
    if not len(way):
        return np.zeros(0)
    at = np.concatenate([[0.0], np.cumsum(way)])
    pushed = np.concatenate([[0.0], np.cumsum(dose)])
    first = np.flatnonzero(begins)
    run = np.cumsum(begins) - 1
    low, high = at[first][run], at[np.append(first[1:], len(way))][run]
    middle, half = (at[:-1] + at[1:]) / 2, np.maximum(way, window) / 2
    begin, end = np.maximum(middle - half, low), np.minimum(middle + half, high)
    there = np.interp(end, at, pushed) - np.interp(begin, at, pushed)
    return np.asarray(np.where(way >= window, dose / way, there / (end - begin)))


def widths(area: FloatArray, height: FloatArray, bead: BeadSection) -> FloatArray:
    """Width of lines of a cross-section, mm.

    Parameters
    ----------
    area : (n,) float64, mm²
    height : (n,) float64, mm
        NaN for a round filament.
    bead : BeadSection
    """
    with np.errstate(invalid="ignore"):
        flat = bead.width(area, height)
    round_one = 2.0 * np.sqrt(np.maximum(area, 0.0) / math.pi)
    return np.where(np.isnan(height), round_one, flat)
