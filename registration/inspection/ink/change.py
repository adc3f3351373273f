"""Tell fresh ink over older ink by how much the view changed there since before.

What ink adds over older ink hangs on what it lies on: it sags, shades and mirrors anew, so that no
profile holds for all places. That it changes the view at all holds for all: a place is told by the
energy of its change, on a scale from what the ground's noise leaves (0) to what most of the layer
shows (1). Where both are hardly apart, or places differ much, that scale is vague and tells
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.noise import (
    MIN_FULL_SPREAD,
    Scatter,
    median_and_spread,
    neighbour_correlation,
    robust_spread,
)
from registration.inspection.ink.shares import ACROSS_WIDTHS, covariance

_CORE_SAMPLES: Final = np.abs(ACROSS_WIDTHS) <= 0.4
"""Samples around a line's middle, in which its own change is looked for."""
_LOW_PERCENTILE: Final = 10.0
"""Percentile of places below the usual by which they are said to scatter; few may be bare."""
_LOW_PERCENTILE_SDS: Final = 1.2816
"""Standard deviations that this lies below the median."""
_SHADE_SPREAD: Final = 0.1
"""Of the scale: what neighbours' shade and slopes change on a bare place."""
_MIN_LOG_CHANGE: Final = 0.3
"""Natural logarithm of the least change that ink is told by."""
_UNSEEN_SHADE: Final = 0.5
"""Of the scale: what shade changes where no bare place beside ink can be seen."""
_MIN_PLACES: Final = 20
"""Places or strips by which a level is learned."""
_MIN_SEPARATION_SDS: Final = 3.0
"""Standard deviations that places with and without ink must lie apart."""


@dataclass(frozen=True)
class Change:
    """How much changed at each place.

    Attributes
    ----------
    share : (n,) float64
        0 for the ground's noise alone, 1 for as much as usual.
    misfit : (n,) float64
        Logarithm of how unlike the usual one a change is.
    scatter : Scatter
        Of both.
    """

    share: FloatArray
    misfit: FloatArray
    scatter: Scatter


def measure_change(
    strips: FloatArray,
    own: FloatArray,
    lost: BoolArray,
    ground: FloatArray,
    beside: FloatArray,
    good: BoolArray,
    run: IntArray,
) -> Change | None:
    """Return how much changed at places; None where ink changes too little to be told by that.

    Parameters
    ----------
    strips : (n, u, c) float64
        What changed across each place.
    own : (n, u, c) float64
        What full ink adds there by its profile.
    lost : (n, u) bool
        Samples that the picture doesn't show.
    ground : (k, u, c) float64
        What changed over ground and older ink, where nothing was written.
    beside : (k, u, c) float64
        The same just beside fresh lines.
    good : (n,) bool
        Places that are seen, without those that are held for bare.
    run : (n,) int64
        Number of the unbroken way that each belongs to.
    """
    if good.sum() < _MIN_PLACES or len(ground) < _MIN_PLACES:
        return None
    log, still = _energy(strips, lost), _energy(ground)
    low, usual = float(np.median(still)), float(np.median(log[good]))
    apart = usual - low
    if apart < _MIN_LOG_CHANGE:
        return None
    full = max(
        (usual - float(np.percentile(log[good], _LOW_PERCENTILE))) / _LOW_PERCENTILE_SDS / apart,
        MIN_FULL_SPREAD,
    )
    noise = robust_spread(still) / apart
    if float(np.hypot(full, noise)) > 1.0 / _MIN_SEPARATION_SDS:
        return None
    shaded = (_UNSEEN_SHADE, _UNSEEN_SHADE / 2.0)
    if len(beside) >= _MIN_PLACES:
        middle, high = np.percentile(
            (_energy(beside) - low) / apart, [50.0, 100.0 - _LOW_PERCENTILE]
        )
        shaded = (float(middle), max(float(high - middle) / _LOW_PERCENTILE_SDS, noise))
    bare = max(float(np.hypot(noise, _SHADE_SPREAD)), full)
    like = np.arange(len(ground)) % len(own)
    misfit, on_ground = _misfits(strips - own, ground - own[like], good)
    share = (log - low) / apart
    correlation = neighbour_correlation(share, full, good, run)
    scatter = Scatter(
        full,
        bare,
        median_and_spread(misfit[good]),
        median_and_spread(on_ground),
        shaded,
        correlation,
    )
    return Change(share, misfit, scatter)


def _misfits(rest: FloatArray, ground: FloatArray, good: BoolArray) -> tuple[FloatArray, ...]:
    """Logarithms of mean squares of rests, (n,) and (k,), by how those of good places scatter."""
    rest, ground = (one[:, _CORE_SAMPLES].reshape(len(one), -1) for one in (rest, ground))
    middle = np.median(rest[good], axis=0)
    inverse = np.linalg.inv(covariance(rest[good] - middle))
    return tuple(
        np.log(np.maximum(np.einsum("ni,ij,nj->n", one, inverse, one) / one.shape[1], 1e-9))
        for one in (rest - middle, ground - middle)
    )


def _energy(strips: FloatArray, lost: BoolArray | None = None) -> FloatArray:
    """Logarithm of the root mean square of what changed, (n,)."""
    square = (strips[:, _CORE_SAMPLES] ** 2).mean(axis=2)
    if lost is None:
        return np.asarray(0.5 * np.log(np.maximum(square.mean(axis=1), 1e-9)))
    shown = (~lost[:, _CORE_SAMPLES]).astype(np.float64)
    mean = (square * shown).sum(axis=1) / np.maximum(shown.sum(axis=1), 1e-9)
    return np.asarray(0.5 * np.log(np.maximum(mean, 1e-9)))
