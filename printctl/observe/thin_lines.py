"""Find the extent and the missing ink share of too-thin stretches, from measured line widths."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.deciding.thin import Thin
from registration.inspection import Gap, Stations, Stretch

_WINDOW: Final = 5
"""Stations whose mean tells whether a place still belongs to a thin stretch."""
_NEAR_END: Final = 1.5
"""Widths from a line's end within which no width is told."""
_LOW_MM: Final = 2.0
"""Shortest way of low ink that is told: scatter and droops of sound layers are shorter."""


def thin_lines(
    stretches: tuple[Stretch, ...], stations: Stations, told: BoolArray, area_ratio: FloatArray
) -> tuple[Thin, ...]:
    """Return thin stretches as far as they go.

    A stretch is where a line is *surely* beyond the tolerance; around it, the line is as thin in
    truth where the mean of some stations lies nearer to the stretch's ratio than to 1.

    Parameters
    ----------
    stretches : tuple of Stretch
    stations : Stations
    told : (m,) bool
        Stations whose width counts: not beside places without ink.
    area_ratio : (m,) float64
        Cross-section seen over the one asked for, where told.
    """
    thin = list[Thin]()
    for stroke in sorted({one.stroke for one in stretches if one.kind == "thin"}):
        rows = np.flatnonzero(told & (stations.stroke == stroke))
        own = [one for one in stretches if one.kind == "thin" and one.stroke == stroke]
        if len(rows) >= _WINDOW:
            thin += _of_stroke(own, stations, rows, area_ratio[rows])
    return tuple(thin)


def runs_below(
    stations: Stations, told: BoolArray, area_ratio: FloatArray, below: float
) -> tuple[Thin, ...]:
    """Return where the mean of some stations' ratio lies below a level, as far as it does.

    Nothing is said of how sure that is: for lines of a flow that is known to be too small.
    """
    thin = list[Thin]()
    for stroke in np.unique(stations.stroke[told]).tolist():
        rows = np.flatnonzero(told & (stations.stroke == stroke))
        if len(rows) >= _WINDOW:
            low = _mean(area_ratio[rows]) < below
            thin += _runs(low, low, stations, rows, area_ratio[rows])
    return tuple(thin)


def low_stretches(stations: Stations, tolerated: float) -> tuple[Gap, ...]:
    """Return where ink on older ink stands lower than elsewhere by more than a share of a layer.

    Heights tell no widths there, and lower ink is thin, or lies in a hollow.
    """
    by_height = stations.seen & np.isnan(stations.width_mm)
    runs = runs_below(stations, by_height, stations.present, 1.0 - tolerated)
    return tuple(_placed(one, stations) for one in runs if one.to_mm - one.from_mm >= _LOW_MM)


def _placed(run: Thin, stations: Stations) -> Gap:
    own = stations.stroke == run.stroke
    along, at = stations.along_mm[own], stations.at_mm[own]
    begin, end = (
        (float(np.interp(one, along, at[:, 0])), float(np.interp(one, along, at[:, 1])))
        for one in (run.from_mm, run.to_mm)
    )
    return Gap(run.stroke, run.from_mm, run.to_mm, begin, end, 0.0, 1.0)


def _of_stroke(
    stretches: list[Stretch], stations: Stations, rows: IntArray, ratio: FloatArray
) -> list[Thin]:
    along, mean = stations.along_mm[rows], _mean(ratio)
    thin, sure = np.zeros(len(rows), dtype=np.bool_), np.zeros(len(rows), dtype=np.bool_)
    for one in stretches:
        within = (along >= one.from_mm) & (along <= one.to_mm)
        if within.any():
            sure |= within
            thin |= within | (mean < (1.0 + float(ratio[within].mean())) / 2)
    return _runs(thin, sure, stations, rows, ratio)


def _mean(ratio: FloatArray) -> FloatArray:
    """Mean over a window around each station."""
    ends = np.pad(ratio, _WINDOW // 2, mode="edge")
    return np.convolve(ends, np.ones(_WINDOW) / _WINDOW, "valid")


def _runs(
    thin: BoolArray, sure: BoolArray, stations: Stations, rows: IntArray, ratio: FloatArray
) -> list[Thin]:
    """Runs of thin stations with a sure one among them, to the stroke's ends where they are near.

    Widths aren't told at a line's ends, which are no thicker than the rest.
    """
    stroke, half = int(stations.stroke[rows[0]]), stations.length_mm[rows] / 2
    along, near = stations.along_mm[rows], _NEAR_END * float(stations.expected_mm[rows].max())
    whole = np.flatnonzero(stations.stroke == stroke)
    end = float((stations.along_mm[whole] + stations.length_mm[whole] / 2).max())
    edges = np.diff(np.concatenate([[0], thin.astype(np.int8), [0]]))
    runs = list[Thin]()
    for first, past in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
        part = slice(first, past)
        missing = 1.0 - float(np.average(ratio[part], weights=half[part]))
        if sure[part].any() and 0.0 < missing < 1.0:
            low, high = along[first] - half[first], along[past - 1] + half[past - 1]
            low, high = (0.0 if low < near else low), (end if end - high < near else high)
            runs.append(Thin(stroke, float(low), float(high), missing))
    return runs
