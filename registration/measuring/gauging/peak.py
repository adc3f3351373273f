"""Estimate a diameter change's peak height and position between sections, corrected for blur."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, pi, sqrt

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.uncertainty.budget import rectangular

_LEAST_KEPT = 0.5
"""Part of its height that a change keeps at least: of one narrower than 1.6 times the blur nothing
tells how high it was."""


@dataclass(frozen=True)
class Peak:
    """Where a change is largest, and by how much.

    Attributes
    ----------
    height : float, mm
        Signed, before the blur.
    along : float, mm
        From the vessel's first node.
    standard : float, mm
        Standard uncertainty of the height by the change's unknown shape, noise apart.
    """

    height: float
    along: float
    standard: float


def peak_of(change: FloatArray, along: FloatArray, worst: int, blur_mm: float) -> Peak:
    """Return the peak at a station.

    A Gaussian blur σ along a vessel lowers a change of the width w at half height to
    erf(w / (2 √2 σ)) of its height where its top is flat and its ends are steep, to
    1 - √(2 / π) σ / w where it is pointed with straight flanks (the mean of |x| is √(2 / π) σ);
    bells lie between. A flat top is as high as the highest station, another as the parabola
    through three or as where the flanks meet. What is in between is as likely as the ends
    (GUM 4.3.7).

    Parameters
    ----------
    change, along : (n,) float64, mm
        Evenly spaced; NaN where not measured.
    worst : int
        The station.
    blur_mm : float, mm
        Standard deviation of the field's blur.
    """
    here = float(change[worst])
    top, place = _parabola(change, along, worst)
    width = _width(change / top if top else change, along, worst)
    flat, pointed = _kept(width, blur_mm)
    tip = max(top, _tip(change, along, worst, width), key=abs) if blur_mm > 0 else top
    ends = here / flat, tip / pointed
    return Peak(sum(ends) / 2, place, rectangular(abs(ends[1] - ends[0]) / 2))


def _parabola(change: FloatArray, along: FloatArray, worst: int) -> tuple[float, float]:
    """Height and place of the vertex through three stations; beside a gap the station itself."""
    here = float(change[worst]), float(along[worst])
    if not 0 < worst < len(change) - 1:
        return here
    before, top, after = change[worst - 1 : worst + 2].tolist()
    bend = before - 2 * top + after
    # NaN compares false.
    if not (abs(top) >= max(abs(before), abs(after)) and bend * top < 0):
        return here
    shift = 0.5 * (before - after) / bend
    return top - 0.25 * (before - after) * shift, here[1] + shift * float(along[1] - along[0])


def _tip(change: FloatArray, along: FloatArray, worst: int, width: float) -> float:
    """Height where straight flanks through a station's neighbours meet.

    A tip δ beside the station makes its neighbours differ by 2 δ of the flanks' slope; δ is no more
    than half a spacing, the slope the height over the width at half height.
    """
    here = float(change[worst])
    if not (0 < worst < len(change) - 1 and np.isfinite(width)):
        return here
    apart = abs(float(change[worst + 1] - change[worst - 1])) / 2
    most = abs(here) * float(along[1] - along[0]) / (2 * width)
    return here + float(np.copysign(min(apart, most), here)) if np.isfinite(apart) else here


def _width(part: FloatArray, along: FloatArray, worst: int) -> float:
    """Full width at half height of parts of a height, mm; inf where no end was measured."""
    step = float(along[1] - along[0])
    return step * (_half_way(part[worst:]) + _half_way(part[worst::-1]))


def _half_way(part: FloatArray) -> float:
    """Stations to where parts of the height fall below a half; inf where they don't.

    Two in a row must lie below: one alone may be noise within a long change.
    """
    low = part < 0.5
    ends = np.flatnonzero(low[:-1] & (low[1:] | np.isnan(part[1:])))
    if len(ends) == 0:
        return float("inf")
    end = int(ends[0])
    return float(end - 1 + (part[end - 1] - 0.5) / (part[end - 1] - part[end]))


def _kept(width: float, blur_mm: float) -> tuple[float, float]:
    """Parts of their height that a flat-topped and a pointed change of a measured width keep."""
    if blur_mm <= 0 or not np.isfinite(width):
        return 1.0, 1.0
    flat = erf(width / (2 * sqrt(2) * blur_mm))
    pointed = 1 - sqrt(2 / pi) * blur_mm / width
    return max(flat, _LEAST_KEPT), max(pointed, _LEAST_KEPT)
