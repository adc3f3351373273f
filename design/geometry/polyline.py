"""Lengths and places along a polyline; frames of unit vectors perpendicular to an axis."""

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
        Lengths from the first point.

    Returns
    -------
    (..., d) float64
    """
    return np.stack([np.interp(at, arc, column) for column in points.T], axis=-1)


def vectors_across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed frame with each unit vector of ``axis``.

    The first is e × axis, e the coordinate axis that lies least along it. The same for an axis and
    its opposite up to order and sign, so that collinear tubes share vertices.

    Parameters
    ----------
    axis : (3,) or (n, 3) float64

    Returns
    -------
    first, second : of the shape of ``axis``
    """
    first = np.cross(np.eye(3)[np.argmin(np.abs(axis), axis=-1)], axis)
    one = axis.ndim == 1
    first /= np.linalg.norm(first) if one else np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(axis, first)
