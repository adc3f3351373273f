"""Calibrate a camera lens from board pictures, flat or tilted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.devices.lens.board import BoardView
from registration.devices.lens.lens import Lens
from registration.errors import PictureError

FEWEST: Final = 5
"""Pictures from which all numbers are fitted."""
_WHOLE_FOCUS_ERROR: Final = 0.01
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
    if error[0] > _WHOLE_FOCUS_ERROR * numbers[0] or error[1:3].max() > _SURE_CENTRE * max(size):
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


_FEWEST_FOR_ALL: Final = 3
"""Pictures from which focal length and k₂ are fitted."""
_FOCUS_ERROR: Final = 0.02
_LONG: Final = 3.0
"""Focal length in sides of the picture, where pictures can't tell it."""
_T95: Final = 1.96
_RADIAL: Final = (
    cv2.CALIB_FIX_PRINCIPAL_POINT
    | cv2.CALIB_FIX_ASPECT_RATIO
    | cv2.CALIB_ZERO_TANGENT_DIST
    | cv2.CALIB_FIX_K3
    | cv2.CALIB_USE_INTRINSIC_GUESS
)


def fit_lens(views: Sequence[BoardView]) -> Lens:
    """Least squares of the corners' pixels, the board's pose free in every picture (Zhang 2000).

    A board that always lies square to the camera can't tell the focal length, and nothing that is
    measured in its plane needs it. It is fitted to three pictures or more, as k₂ is, and kept
    where they tell it to 2 %. From five pictures that tell focal length and optical axis to 1 %
    all numbers are fitted, with their covariance: a camera that looks at a dish from aside needs
    them. The scale is that of the first picture.

    Parameters
    ----------
    views : sequence of BoardView
        The first with the board where prints will lie.

    Raises
    ------
    PictureError
        When there is none, or their pictures differ in size.

    Notes
    -----
    Zhang, IEEE Trans. PAMI 22, 1330, doi 10.1109/34.888718.
    """
    sizes = {view.size_px for view in views}
    if len(sizes) != 1:
        told = ", ".join(f"{wide} x {high}" for wide, high in sorted(sizes)) or "none"
        raise PictureError(f"pictures of a board must be of one size; these are {told}")
    (size,) = sizes
    focal = _LONG * max(size)
    whole = fit_whole(views, _start(focal, size))
    if whole is not None:
        numbers, covariance, off, relative = whole
        held = tuple(tuple(map(float, row)) for row in covariance)
        return _scaled(views[0], relative, size, numbers, off, held)
    if len(views) >= _FEWEST_FOR_ALL:
        _, matrix, _, error, _ = _solved(views, size, focal, _RADIAL)
        if error[0] < _FOCUS_ERROR * matrix[0, 0]:
            focal = float(matrix[0, 0])
    flags = _RADIAL | cv2.CALIB_FIX_FOCAL_LENGTH
    if len(views) < _FEWEST_FOR_ALL:
        # A second term that isn't there would bend what the board doesn't reach.
        flags |= cv2.CALIB_FIX_K2
    off, matrix, radial, _, relative = _solved(views, size, focal, flags)
    numbers = np.array([focal, matrix[0, 2], matrix[1, 2], radial[0], radial[1]])
    return _scaled(views[0], relative, size, numbers, off, None)


def _scaled(
    view: BoardView,
    relative: float,
    size: tuple[int, int],
    numbers: FloatArray,
    off: float,
    covariance: tuple[tuple[float, ...], ...] | None,
) -> Lens:
    """Lens of fitted numbers (`Lens.numbers`, or its first five), its scale that of a picture."""
    focal, u, v, *bent = map(float, numbers)
    lens = Lens(
        size_px=size,
        focal_px=focal,
        centre_px=(u, v),
        distortion=(bent[0], bent[1]) if covariance is None else _five(bent),
        um_per_px=1.0,
        um_per_px_95=(1.0, 1.0),
        off_px=off,
        covariance=covariance,
    )
    scale = _um_per_px(lens, view)
    half = _T95 * relative * scale
    return lens.model_copy(
        update={"um_per_px": scale, "um_per_px_95": (scale - half, scale + half)}
    )


def _five(bent: Sequence[float]) -> tuple[float, float, float, float, float]:
    k1, k2, p1, p2, k3 = bent
    return k1, k2, p1, p2, k3


def _start(focal: float, size: tuple[int, int]) -> FloatArray:
    """Camera matrix with the optical axis in the picture's middle, (3, 3)."""
    return np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])


def _solved(
    views: Sequence[BoardView], size: tuple[int, int], focal: float, flags: int
) -> tuple[float, FloatArray, FloatArray, FloatArray, float]:
    """RMS px, camera matrix, distortion, errors of both, relative error of the first distance."""
    flat = [np.column_stack([v.places_mm, 0 * v.places_mm[:, :1]]) for v in views]
    off, matrix, radial, _, along, error, posed, _ = cv2.calibrateCameraExtended(
        [one.astype(np.float32) for one in flat],
        [view.pixels.astype(np.float32) for view in views],
        size,
        _start(focal, size),
        np.zeros(5),
        flags=flags,
    )
    relative = float(posed.ravel()[5]) / abs(float(along[0].ravel()[2]))
    return float(off), matrix, radial.ravel(), error.ravel(), relative


def _um_per_px(lens: Lens, view: BoardView) -> float:
    """Scale of a straightened picture in its middle."""
    seen = lens.straight_pixels(view.pixels)
    matrix = np.asarray(cv2.findHomography(view.places_mm, seen, 0)[0])
    middle = (np.array(lens.size_px) - 1) / 2
    pixel = middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    a, b, c = cv2.perspectiveTransform(pixel[:, None], np.linalg.inv(matrix))[:, 0]
    (x0, y0), (x1, y1) = b - a, c - a
    return float(1e3 * np.sqrt(abs(x0 * y1 - y0 * x1)))
