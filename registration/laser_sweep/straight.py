"""Fit a straight line to places of which some are others'."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
    one, other = np.flatnonzero(first), np.flatnonzero(~first)
    if min(len(one), len(other)) < fewest:
        return None
    near = _most_joined(at, one, other)
    for _ in range(_ROUNDS):
        if min(near[first].sum(), near[~first].sum()) < fewest:
            return None
        middle = at[near].mean(axis=0)
        along = np.linalg.eigh(np.cov(at[near].T))[1][:, 1]
        off = (at - middle) @ np.array([-along[1], along[0]])
        spread = 1.4826 * float(np.median(np.abs(off[near])))
        near = np.abs(off) < min(_NEAR_MM, max(3 * spread, _CLOSEST_MM))
    reach = (at[near] - middle) @ along
    ends = middle + np.array([[reach.min()], [reach.max()]]) * along
    return Straight(ends, float(np.sqrt(np.mean(off[near] ** 2))))


def _most_joined(
    at: FloatArray, one: NDArray[np.int64], other: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which places are near the best of the lines that join two of them, (n,)."""
    some = at[:: max(1, len(at) // _JUDGES)]
    a, b = (at[k[np.linspace(0, len(k) - 1, _TRIES).astype(int)]] for k in (one, other))
    a, b = np.repeat(a, _TRIES, axis=0), np.tile(b, (_TRIES, 1))
    way = b - a
    normal = np.column_stack([-way[:, 1], way[:, 0]])
    normal /= np.maximum(np.linalg.norm(way, axis=1), 1e-9)[:, None]
    offset = (normal * a).sum(axis=1)
    near = np.abs(normal @ some.T - offset[:, None]) < _NEAR_MM
    best = near.sum(axis=1).argmax()
    return np.asarray(np.abs(at @ normal[best] - offset[best]) < _NEAR_MM)
