"""Find straight soft shadows across a picture's bath, and how much light they take.

A camera arm casts them, a syringe, a lamp's frame. In logarithms a shadow adds a function of the
place across it alone, a ridge function (Friedman and Stuetzle 1981, J. Am. Stat. Assoc. 76, 817:
projection pursuit regression). It is learned from bath and holds for ink as well, also where lines
leave no bath between them. Only what both halves of the picture show along the bar counts: a blob,
a needle or a dragged line isn't light.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray

_MOST: Final = 3
_ANGLES: Final = 36
_ALIKE: Final = 0.5
"""Correlation of both halves' profiles, at least."""
_EXPLAINED: Final = 0.1
"""Of the bath's remaining variance, that a bar explains at least."""
_FEWEST: Final = 4
"""Cells of a half in a bin of a profile."""
_FEWEST_BINS: Final = 6


@dataclass(frozen=True)
class _Bins:
    """Cells by their place across a direction, and by the half of the picture along it."""

    of: IntArray
    half: BoolArray
    count: int


def bar_directions(
    rest: FloatArray, weight: FloatArray, at: FloatArray, bin_width: float
) -> list[float]:
    """Return the directions across straight bars in the bath's light, radians.

    Parameters
    ----------
    rest : (n, c) float64
        Logarithm of brightness of the bath less that of even light.
    weight : (n,) float64
        Share of bath in each cell; 0 where there is none.
    at : (n, 2) float64
        Places of cells.
    bin_width : float
        In the unit of ``at``.
    """
    use = weight > 0
    if use.sum() < _FEWEST * _FEWEST_BINS:
        return []
    grey, own, place = rest[use].mean(axis=1), weight[use], at[use]
    found: list[float] = []
    while len(found) < _MOST:
        angle = _direction(grey, own, place, bin_width)
        if angle is None:
            break
        found.append(angle)
        grey = grey - _profile(grey[:, None], own, place, angle, bin_width)[:, 0]
    return found


def bar_light(
    rest: FloatArray, weight: FloatArray, at: FloatArray, bin_width: float, angles: list[float]
) -> FloatArray:
    """Return what bars across ``angles`` add to each cell's light, (n, c)."""
    total = np.zeros_like(rest)
    for angle in angles:
        total += _profile(rest - total, weight, at, angle, bin_width)
    return total


def _direction(
    rest: FloatArray, weight: FloatArray, at: FloatArray, bin_width: float
) -> float | None:
    """Direction across the strongest bar, radians; None where there is none."""
    rest = rest - (weight @ rest) / weight.sum()
    variance = float(weight @ rest**2)
    step = np.pi / _ANGLES
    tried = [(*_score(rest, weight, at, k * step, bin_width), k * step) for k in range(_ANGLES)]
    best = max(tried)
    for _ in range(3):
        step /= 2
        near = (best[2] - step, best[2] + step)
        best = max(best, *((*_score(rest, weight, at, a, bin_width), a) for a in near))
    score, alike, angle = best
    return angle if score > _EXPLAINED * variance and alike > _ALIKE else None


def _score(
    rest: FloatArray, weight: FloatArray, at: FloatArray, angle: float, bin_width: float
) -> tuple[float, float]:
    """Variance that both halves' profiles have in common, weighted; their correlation."""
    bins = _binned(at, weight, angle, bin_width)
    index = bins.of + bins.half * bins.count
    size = 2 * bins.count
    total = np.bincount(index, weights=weight, minlength=size).reshape(2, -1)
    cells = np.bincount(index, minlength=size).reshape(2, -1)
    known = (cells >= _FEWEST).all(axis=0)
    if known.sum() < _FEWEST_BINS:
        return 0.0, 0.0
    shared = total[:, known].sum(axis=0)
    sums = np.bincount(index, weights=weight * rest, minlength=size).reshape(2, -1)
    mean = sums[:, known] / total[:, known]
    mean -= (mean @ shared / shared.sum())[:, None]
    both = float(shared @ (mean[0] * mean[1]))
    power = (mean**2) @ shared
    return both, both / max(float(np.sqrt(power[0] * power[1])), 1e-12)


def _binned(at: FloatArray, weight: FloatArray, angle: float, bin_width: float) -> _Bins:
    across, along = at @ (np.cos(angle), np.sin(angle)), at @ (-np.sin(angle), np.cos(angle))
    of = np.floor((across - across.min()) / bin_width).astype(np.int64)
    return _Bins(of, along > float(weight @ along) / float(weight.sum()), int(of.max()) + 1)


def _profile(
    rest: FloatArray, weight: FloatArray, at: FloatArray, angle: float, bin_width: float
) -> FloatArray:
    """Median of the bath by place across a bar, smoothed, at all cells, (n, c)."""
    across = at @ (np.cos(angle), np.sin(angle))
    of = np.floor((across - across.min()) / bin_width).astype(np.int64)
    use = np.flatnonzero(weight > 0)
    own = of[use]
    _, first, count = np.unique(np.sort(own), return_index=True, return_counts=True)
    enough = count >= _FEWEST
    middle = (first + count // 2)[enough]
    if len(middle) < 2:
        return np.zeros_like(rest)
    out = np.empty_like(rest)
    places = across[use][np.lexsort((across[use], own))][middle]
    for c in range(rest.shape[1]):
        values = rest[use, c]
        level = values[np.lexsort((values, own))][middle]
        padded = np.concatenate([level[:1], level, level[-1:]])
        smooth = 0.25 * padded[:-2] + 0.5 * padded[1:-1] + 0.25 * padded[2:]
        out[:, c] = np.interp(across, places, smooth)
    return out
