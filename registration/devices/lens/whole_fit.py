"""Fit focal length, principal point, distortion and covariance to tilted board pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.devices.lens.board import BoardView

FEWEST: Final = 5
"""Pictures from which all numbers are fitted."""
_SURE_FOCUS: Final = 0.01
_SURE_CENTRE: Final = 0.01
"""Standard uncertainties up to which such a fit is kept: of the focal length, of the side."""
_SURE_TERM: Final = 4.0
"""Standard uncertainties that k₃ must be from 0 to be kept."""
_LEAST_TOLD: Final = 1e-9
"""Smallest eigenvalue of the normal matrix with ones on its diagonal; below, a mix of numbers can
be anything."""
_FLAGS: Final = cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS


def fit_whole(
    views: Sequence[BoardView], start: FloatArray
) -> tuple[FloatArray, FloatArray, float, float] | None:
    """Fit focal length, optical axis, and radial and tangential terms.

    Parameters
    ----------
    views : sequence of BoardView
    start : (3, 3) float64
        Camera matrix to begin with.

    Returns
    -------
    numbers : (8,) float64
        As `Lens.numbers`.
    covariance : (8, 8) float64
    off_px : float
        RMS of the corners about the fit.
    relative : float
        Standard uncertainty of the first picture's distance, as a share.

    None where there are too few pictures, or they don't tell the numbers (a board that always
    lies square to the camera).
    """
    if len(views) < FEWEST:
        return None
    plain = _fitted(views, start, True)
    more = _fitted(views, start, False)
    if more is not None and abs(more[0][7]) > _SURE_TERM * np.sqrt(more[1][7, 7]):
        return more  # a third radial term that isn't there would bend what the boards don't reach
    return plain


def _fitted(
    views: Sequence[BoardView], start: FloatArray, flat: bool
) -> tuple[FloatArray, FloatArray, float, float] | None:
    """As `fit_whole`; ``flat`` with k₃ = 0."""
    size = views[0].size_px
    places = [np.column_stack([v.places_mm, 0 * v.places_mm[:, :1]]) for v in views]
    off, matrix, bent, turns, ways = cv2.calibrateCamera(
        [one.astype(np.float32) for one in places],
        [view.pixels.astype(np.float32) for view in views],
        size,
        start.copy(),
        np.zeros(5),
        flags=_FLAGS | (cv2.CALIB_FIX_K3 if flat else 0),
    )
    numbers = np.array([matrix[0, 0], matrix[0, 2], matrix[1, 2], *np.ravel(bent)[:5]])
    poses = list(zip(turns, ways, strict=True))
    covariance, distance = _covariance(numbers, places, views, poses, 7 if flat else 8)
    error = np.sqrt(np.diag(covariance))
    if not np.isfinite(error).all():
        return None
    if error[0] > _SURE_FOCUS * numbers[0] or error[1:3].max() > _SURE_CENTRE * max(size):
        return None
    return numbers, covariance, float(off), distance


def _covariance(
    numbers: FloatArray,
    places: Sequence[FloatArray],
    views: Sequence[BoardView],
    poses: Sequence[tuple[FloatArray, FloatArray]],
    free: int,
) -> tuple[FloatArray, float]:
    """Covariance of the numbers, poses eliminated, the last ones fixed; error of a distance."""
    normal, unlike, count = np.zeros((free, free)), 0.0, 0
    first: tuple[FloatArray, FloatArray] | None = None
    matrix = np.array([[numbers[0], 0, numbers[1]], [0, numbers[0], numbers[2]], [0, 0, 1.0]])
    for place, view, (turn, way) in zip(places, views, poses, strict=True):
        seen, slope = cv2.projectPoints(place, turn, way, matrix, numbers[3:])
        pose = slope[:, :6]
        # Columns of OpenCV: turn, way, fx, fy, cx, cy, k1, k2, p1, p2, k3.
        own = np.column_stack([slope[:, 6] + slope[:, 7], slope[:, 8:15]])[:, :free]
        held, mixed = pose.T @ pose, pose.T @ own
        normal += own.T @ own - mixed.T @ np.linalg.solve(held, mixed)
        unlike += float(((seen[:, 0] - view.pixels) ** 2).sum())
        count += 2 * len(place) - 6
        if first is None:
            first = held, mixed
    variance = unlike / max(count - free, 1)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    even = normal / np.outer(size, size)
    if np.linalg.eigvalsh(even)[0] < _LEAST_TOLD:
        return np.full((8, 8), np.inf), float("inf")
    inner = np.linalg.inv(even) / np.outer(size, size)
    assert first is not None
    lever = np.linalg.solve(*first)
    posed = np.linalg.inv(first[0]) + lever @ inner @ lever.T
    away = abs(float(np.ravel(poses[0][1])[2]))
    whole = np.zeros((8, 8))
    whole[:free, :free] = variance * inner
    return whole, float(np.sqrt(variance * posed[5, 5])) / away
