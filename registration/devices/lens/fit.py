"""Calibrate a camera lens from board pictures: as many parameters as the pictures determine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.devices.lens.board import BoardView
from registration.devices.lens.lens import Lens
from registration.devices.lens.whole_fit import fit_whole
from registration.errors import PictureError

_FEWEST_FOR_ALL: Final = 3
"""Pictures from which focal length and k₂ are fitted."""
_SURE_FOCUS: Final = 0.02
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
        if error[0] < _SURE_FOCUS * matrix[0, 0]:
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
