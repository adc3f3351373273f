"""Fit a straight line to places of which some are others'."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import FloatArray

_NEAR_MM: Final = 0.12
_TRIES: Final = 10
"""Places of either side that are joined, evenly spread."""
_JUDGES: Final = 300
"""Places that lines are tried by."""
_CLOSEST_MM: Final = 0.015
_ROUNDS: Final = 4


@dataclass(frozen=True)
class Straight:
    """A line through places.

    Attributes
    ----------
    ends : (2, 2) float64, mm
        Its outermost places.
    off_mm : float, mm
        RMS of the places about it.
    """

    ends: FloatArray
    off_mm: float


def straight_line(at: FloatArray, first: NDArray[np.bool_], fewest: int) -> Straight | None:
    """Return the line that most places are on; None where either part has fewer than ``fewest``.

    Parameters
    ----------
    at : (n, 2) float64, mm
    first : (n,) bool
        One of two parts, both of which it must run through.
    fewest : int
    """
    ends, off_mm, found = _straight(at, first, fewest)
    return Straight(ends, off_mm) if found else None


@jit
def _straight(
    at: FloatArray, first: NDArray[np.bool_], fewest: int
) -> tuple[FloatArray, float, bool]:
    """Ends of the line, RMS of its places about it, and whether there is one."""
    ends = np.zeros((2, 2))
    one, other = np.flatnonzero(first), np.flatnonzero(~first)
    if min(len(one), len(other)) < fewest:
        return ends, 0.0, False
    near = _most_joined(at, one, other)
    middle, along, off = np.zeros(2), np.zeros(2), np.zeros(len(at))
    for _ in range(_ROUNDS):
        count = near.sum()
        if min((near & first).sum(), count - (near & first).sum()) < fewest:
            return ends, 0.0, False
        x, y = at[:, 0], at[:, 1]
        middle[0], middle[1] = x[near].mean(), y[near].mean()
        dx, dy = x - middle[0], y - middle[1]
        u, v = dx[near], dy[near]
        turn = 0.5 * np.arctan2(2.0 * (u * v).sum(), (u * u).sum() - (v * v).sum())
        along[0], along[1] = np.cos(turn), np.sin(turn)
        off = dy * along[0] - dx * along[1]
        spread = 1.4826 * np.median(np.abs(off[near]))
        near = np.abs(off) < min(_NEAR_MM, max(3 * spread, _CLOSEST_MM))
    reach = ((at[:, 0] - middle[0]) * along[0] + (at[:, 1] - middle[1]) * along[1])[near]
    ends[0], ends[1] = middle + reach.min() * along, middle + reach.max() * along
    return ends, np.sqrt(np.mean(off[near] ** 2)), True


@jit
def _most_joined(
    at: FloatArray, one: NDArray[np.int64], other: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which places are near the best of the lines that join two of them, (n,)."""
    step = max(1, len(at) // _JUDGES)
    most, normal_x, normal_y, offset = -1, 0.0, 0.0, 0.0
    for i in range(_TRIES):
        a = at[one[i * (len(one) - 1) // (_TRIES - 1)]]
        for j in range(_TRIES):
            b = at[other[j * (len(other) - 1) // (_TRIES - 1)]]
            size = max(np.hypot(b[0] - a[0], b[1] - a[1]), 1e-9)
            x, y = (a[1] - b[1]) / size, (b[0] - a[0]) / size
            level = x * a[0] + y * a[1]
            count = 0
            for k in range(0, len(at), step):
                count += abs(x * at[k, 0] + y * at[k, 1] - level) < _NEAR_MM
            if count > most:
                most, normal_x, normal_y, offset = count, x, y, level
    return np.abs(at[:, 0] * normal_x + at[:, 1] * normal_y - offset) < _NEAR_MM
