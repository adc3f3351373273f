"""Detect fresh ink over older ink by the view's change.

What ink adds over older ink depends on what it lies on: it sags, shades and mirrors anew, so that
no profile holds for all places. But ink changes the view everywhere: a place is judged by the
energy of its change, on a scale from the ground's noise (0) to the layer's median (1). Where both
hardly differ, or places scatter much, the scale is too vague to use.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.ink.noise import (
    MIN_FULL_SPREAD,
    Scatter,
    median_and_spread,
    neighbour_correlation,
    robust_spread,
)
from printctl.inspection.ink.shares import ACROSS_WIDTHS, covariance

_CORE_SAMPLES: Final = np.abs(ACROSS_WIDTHS) <= 0.4
"""Samples near a line's middle, where its change is measured."""
_LOW_PERCENTILE: Final = 10.0
"""Percentile by which the places' scatter is measured; few places may be bare."""
_LOW_PERCENTILE_SDS: Final = 1.2816
"""Distance of this percentile below the median, in standard deviations."""
_SHADE_SPREAD: Final = 0.1
"""Change on a bare place by its neighbours' shade and slopes, on the scale."""
_MIN_LOG_CHANGE: Final = 0.3
"""Least difference in log energy between ground and ink."""
_UNSEEN_SHADE: Final = 0.5
"""Change by shade, on the scale, where no bare place beside ink is seen."""
_MIN_PLACES: Final = 20
"""Least number of places or strips for learning a level."""
_MIN_SEPARATION_SDS: Final = 3.0
"""Least separation of places with and without ink, in standard deviations."""


@dataclass(frozen=True)
class Change:
    """Change of the view at each place, on the scale from ground to ink.

    Attributes
    ----------
    share : (n,) float64
        0 for the ground's noise alone, 1 for as much as usual.
    misfit : (n,) float64
        Logarithm of a change's misfit to the usual one.
    scatter : Scatter
        Scatter of share and misfit.
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
    """Measure the change at places; return None where ink changes the view too little.

    Parameters
    ----------
    strips : (n, u, c) float64
        Change across each place.
    own : (n, u, c) float64
        Full ink's profile there.
    lost : (n, u) bool
        Samples that the picture lost.
    ground : (k, u, c) float64
        Change over ground and older ink, where nothing was written.
    beside : (k, u, c) float64
        Change just beside fresh lines.
    good : (n,) bool
        Places that are seen and not assumed bare.
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
    """Return log mean squares of rests, (n,) and (k,), weighted by good places' covariance."""
    rest, ground = (one[:, _CORE_SAMPLES].reshape(len(one), -1) for one in (rest, ground))
    middle = np.median(rest[good], axis=0)
    inverse = np.linalg.inv(covariance(rest[good] - middle))
    return tuple(
        np.log(np.maximum(np.einsum("ni,ij,nj->n", one, inverse, one) / one.shape[1], 1e-9))
        for one in (rest - middle, ground - middle)
    )


def _energy(strips: FloatArray, lost: BoolArray | None = None) -> FloatArray:
    """Return the log root mean square of the change, (n,)."""
    square = (strips[:, _CORE_SAMPLES] ** 2).mean(axis=2)
    if lost is None:
        return np.asarray(0.5 * np.log(np.maximum(square.mean(axis=1), 1e-9)))
    shown = (~lost[:, _CORE_SAMPLES]).astype(np.float64)
    mean = (square * shown).sum(axis=1) / np.maximum(shown.sum(axis=1), 1e-9)
    return np.asarray(0.5 * np.log(np.maximum(mean, 1e-9)))
