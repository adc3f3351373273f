"""Whether fresh ink came over older ink: by how much the view changed there since before.

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
from registration.inspection.ink.shares import ACROSS, covariance

_INNER: Final = 0.4
"""Widths from a line's middle, within which its own change is looked for."""
_LOW: Final = 10.0
"""Percentile of places below the usual by which they are said to scatter; few may be bare."""
_LOW_AT: Final = 1.2816
"""Standard deviations that this lies below the median."""
_SHADED: Final = 0.1
"""Of the scale: what neighbours' shade and slopes change on a bare place."""
_LEAST: Final = 0.02
_APART: Final = 0.3
"""Natural logarithm of the least change that ink is told by."""
_UNKNOWN: Final = 0.5
"""Of the scale: what shade changes where no bare place beside ink can be seen."""
_FEWEST: Final = 20
_TOLD: Final = 3.0
"""Standard deviations that places with and without ink must lie apart."""
_MOST_TIED: Final = 0.95


@dataclass(frozen=True)
class Change:
    """How much changed at each place.

    Attributes
    ----------
    share : (n,) float64
        0 for the ground's noise alone, 1 for as much as usual.
    full, bare : float
        Its spread where ink came, and where none did.
    tie : float
        Correlation of neighbouring places.
    """

    share: FloatArray
    full: float
    bare: float
    tie: float
    misfit: FloatArray
    misfit_full: tuple[float, float]
    misfit_bare: tuple[float, float]
    shaded: tuple[float, float]


def change_of(
    strips: FloatArray,
    own: FloatArray,
    lost: BoolArray,
    ground: FloatArray,
    beside: FloatArray,
    good: BoolArray,
    run: IntArray,
) -> Change | None:
    """Return it; None where ink changes too little to be told by that.

    Parameters
    ----------
    strips : (n, u, c) float64
        What changed across each place.
    lost : (n, u) bool
    ground : (k, u c) float64
        The same over ground and older ink, where nothing was written.
    good : (n,) bool
        Places that are seen, without those that are held for bare.
    run : (n,) int64
    """
    if good.sum() < _FEWEST or len(ground) < _FEWEST:
        return None
    log = _energy(strips, lost)
    still = _energy(ground.reshape(len(ground), *strips.shape[1:]), None)
    low, usual = float(np.median(still)), float(np.median(log[good]))
    apart = usual - low
    if apart < _APART:
        return None
    spread = (usual - float(np.percentile(log[good], _LOW))) / _LOW_AT / apart
    noise = 1.4826 * float(np.median(np.abs(still - low))) / apart
    shaded = (_UNKNOWN, _UNKNOWN / 2.0)
    if len(beside) >= _FEWEST:
        near = (_energy(beside.reshape(len(beside), *strips.shape[1:]), None) - low) / apart
        middle, high = np.percentile(near, [50.0, 100.0 - _LOW])
        shaded = (float(middle), max(float(high - middle) / _LOW_AT, float(noise)))
    share = (log - low) / apart
    spread = max(spread, _LEAST)
    if float(np.hypot(spread, noise)) > 1.0 / _TOLD:
        return None
    bare = max(float(np.hypot(noise, _SHADED)), spread)
    misfit, on_ground = _misfits(
        strips - own,
        ground.reshape(len(ground), *strips.shape[1:]) - own[np.arange(len(ground)) % len(own)],
        good,
    )
    return Change(
        share,
        spread,
        bare,
        _tie(share, good, run),
        misfit,
        _level(misfit[good]),
        _level(on_ground),
        shaded,
    )


def _misfits(
    rest: FloatArray, ground: FloatArray, good: BoolArray
) -> tuple[FloatArray, FloatArray]:
    inner = np.abs(ACROSS) <= _INNER
    rest, ground = (one[:, inner].reshape(len(one), -1) for one in (rest, ground))
    middle = np.median(rest[good], axis=0)
    inverse = np.linalg.inv(covariance(rest[good] - middle))
    return tuple(
        np.log(np.maximum(np.einsum("ni,ij,nj->n", one, inverse, one) / one.shape[1], 1e-9))
        for one in (rest - middle, ground - middle)
    )


def _level(values: FloatArray) -> tuple[float, float]:
    middle = float(np.median(values))
    return middle, max(1.4826 * float(np.median(np.abs(values - middle))), 0.1)


def _energy(strips: FloatArray, lost: BoolArray | None) -> FloatArray:
    """Logarithm of the root mean square of what changed, (n,)."""
    inner = np.abs(ACROSS) <= _INNER
    square = (strips[:, inner] ** 2).mean(axis=2)
    if lost is None:
        return np.asarray(0.5 * np.log(np.maximum(square.mean(axis=1), 1e-9)))
    shown = (~lost[:, inner]).astype(np.float64)
    mean = (square * shown).sum(axis=1) / np.maximum(shown.sum(axis=1), 1e-9)
    return np.asarray(0.5 * np.log(np.maximum(mean, 1e-9)))


def _tie(share: FloatArray, good: BoolArray, run: IntArray) -> float:
    pair = np.flatnonzero(good[1:] & good[:-1] & (run[1:] == run[:-1]))
    if not len(pair):
        return 0.5
    off = np.clip(share - np.median(share[good]), -1.0, 1.0)
    a, b = off[pair], off[pair + 1]
    tie = float((a * b).sum() / max(float((a * a).sum()), 1e-9))
    return min(max(tie, 0.0), _MOST_TIED)
