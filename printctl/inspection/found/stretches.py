"""Find thin and thick stretches; estimate the layer's width ratio."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from scipy.special import ndtr

from kernels.arrays import BoolArray, IntArray
from printctl.inspection.found.line_width import StationWidths
from printctl.inspection.values import Stations, Stretch

_WINDOW_STATIONS: Final = 3
"""Stations averaged in a moving window."""
_MIN_COMMON_U: Final = 0.03
"""Least relative standard uncertainty common to a layer's widths."""
_TRIM_ROUNDS: Final = 4
_OUTLIER_SPREADS: Final = 3.0
"""Spreads from the median beyond which a station's ink differs from the others'."""
_MIN_SPREAD: Final = 0.02
"""Least spread of shares of ink where lines touch."""
_MIN_UNCERTAINTIES: Final = 4.0
"""Standard uncertainties by which a stretch must exceed the tolerance."""


def find_all_stretches(
    stations: Stations, widths: StationWidths, percent: float
) -> tuple[Stretch, ...]:
    """Return stretches by widths, and by shares of ink where lines touch."""
    found = find_stretches(stations, widths, percent)
    seam = stations.seam_share
    if seam is None or not np.isfinite(seam).any():
        return found
    # Scatter is that of sound stations, from which thin stretches are trimmed.
    sound, spread = seam[np.isfinite(seam)], 0.0
    for _ in range(_TRIM_ROUNDS):
        off = np.abs(sound - np.median(sound))
        spread = max(1.4826 * float(np.median(off)), _MIN_SPREAD)
        sound = sound[off <= _OUTLIER_SPREADS * spread]
    width = seam / float(np.median(sound)) * stations.expected_mm
    random = np.where(np.isfinite(seam), spread, np.nan) * stations.expected_mm
    by_seams = replace(widths, width_mm=width, random_mm=random, common=0.0)
    return found + find_stretches(replace(stations, width_mm=width), by_seams, percent)


def find_stretches(
    stations: Stations, widths: StationWidths, percent: float
) -> tuple[Stretch, ...]:
    """Return stretches whose mean over some stations is significantly out of tolerance."""
    ratio = stations.width_mm / stations.expected_mm
    known = np.isfinite(ratio)
    found: list[Stretch] = []
    if known.any():
        # A layer whose lines are on the whole as wide as they should be isn't misread by much more.
        off = math.hypot(float(np.median(ratio[known])) - 1.0, _MIN_COMMON_U)
        widths = replace(widths, common=min(widths.common, off))
    for stroke in np.unique(stations.stroke[known]):
        rows = np.flatnonzero(known & (stations.stroke == stroke))
        if len(rows) >= _WINDOW_STATIONS:
            found += _find_in_stroke(stations, widths, rows, percent / 100.0)
    return tuple(found)


def _find_in_stroke(
    stations: Stations, widths: StationWidths, rows: IntArray, tolerance: float
) -> list[Stretch]:
    ratio = stations.width_mm[rows] / stations.expected_mm[rows]
    random = widths.random_mm[rows] / stations.expected_mm[rows]
    ones = np.ones(_WINDOW_STATIONS) / _WINDOW_STATIONS
    # Neighbours share noise: a window counts as one and a half places, not three.
    mean = np.convolve(ratio, ones, "valid")
    common = widths.common * mean  # relative to the width that is seen
    u = np.sqrt(np.convolve(random**2, ones, "valid") / 1.5 + common**2)
    found = []
    kinds: tuple[tuple[Literal["thin", "thick"], float], ...] = (("thin", -1.0), ("thick", 1.0))
    for kind, way in kinds:
        beyond = way * (mean - 1.0) - tolerance > _MIN_UNCERTAINTIES * u
        for first, last in _runs(beyond):
            part = rows[first : last + _WINDOW_STATIONS]
            inner = slice(first, last + _WINDOW_STATIONS)
            at, own = float(ratio[inner].mean()), float(u[first : last + 1].min())
            half = stations.length_mm[part] / 2
            found.append(
                Stretch(
                    kind,
                    int(stations.stroke[part[0]]),
                    float(stations.along_mm[part[0]] - half[0]),
                    float(stations.along_mm[part[-1]] + half[-1]),
                    at,
                    own,
                    float(ndtr(-abs(at - 1.0) / own)),
                )
            )
    return found


def _runs(flags: BoolArray) -> list[tuple[int, int]]:
    edge = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    first, past = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)
    return list(zip(first.tolist(), (past - 1).tolist(), strict=True))


def width_ratio(stations: Stations, widths: StationWidths) -> tuple[float, float]:
    """Return measured over expected width of all stations and its u; NaN, inf for none.

    The median, so that thin stretches beside gaps don't count twice. Stations of one stroke vary
    together; the strokes' own medians show how much.
    """
    ratio = stations.width_mm / stations.expected_mm
    known = np.isfinite(ratio)
    if known.sum() < _WINDOW_STATIONS:
        return math.nan, math.inf
    rows = np.flatnonzero(known)
    middle = float(np.median(ratio[rows]))
    spread = 1.4826 * float(np.median(np.abs(ratio[rows] - middle)))
    of_strokes = [
        float(np.median(ratio[known & (stations.stroke == stroke)]))
        for stroke in np.unique(stations.stroke[rows])
    ]
    by_place = spread / math.sqrt(max(1.0, len(rows) / 4.0))
    by_stroke = float(np.std(of_strokes)) / math.sqrt(len(of_strokes)) if of_strokes[2:] else 0.0
    common = widths.common * middle
    return middle, math.sqrt(common**2 + 1.57 * max(by_place, by_stroke) ** 2)
