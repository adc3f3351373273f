"""Lengths along a polyline up to each of its points, and places at given lengths."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray


def arc_lengths(points: NDArray[Any]) -> FloatArray:
    """Return the length from the first of ``points`` (n, d) along the polyline to each, (n,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def places_along(points: NDArray[Any], arc: FloatArray, at: NDArray[Any]) -> FloatArray:
    """Return places on a polyline at lengths along it; its ends beyond them.

    Parameters
    ----------
    points : (n, d) float64
    arc : (n,) float64
        As `arc_lengths` gives it, or any other measure that grows along the polyline.
    at : (...) float64
        Lengths asked for.

    Returns
    -------
    (..., d) float64
    """
    return np.stack([np.interp(at, arc, column) for column in points.T], axis=-1)
