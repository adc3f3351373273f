"""Find an insert's ArUco marks in a picture: corners, blur, brightness; hidden ones left out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from registration.devices.camera_frame.insert import DICTIONARY, Insert
from registration.devices.camera_frame.mark_edges import edge_corners
from registration.devices.lens import Lens
from registration.errors import PictureError

_COARSE_PX: Final = 1800
"""Longest side of the copy in which marks are looked for first."""
_NEAR: Final = 0.02
"""Of the plate's size: a mark farther from the others' plane isn't one of the insert."""
FEWEST: Final = 4
"""Marks that must be seen."""


@dataclass(frozen=True, eq=False)
class SeenMarks:
    """Marks of an insert in one picture.

    Attributes
    ----------
    index : (n,) int64
        Into the insert's marks, ascending.
    corners : (n, 4, 2) float64, px
        In the order of `Insert.corners`.
    u_px : (n,) float64
        Standard uncertainty of a corner along each axis, by the scatter of its edges.
    blur_px : float
        Deviation of the blur.
    black, white : float
        Medians, of the picture's own range 0 to 1.
    gamma : float
        Power of a picture's values that is proportional to light, by the marks' edges.
    """

    index: IntArray
    corners: FloatArray
    u_px: FloatArray
    blur_px: float
    black: float
    white: float
    gamma: float = 1.0


def grey_picture(image: NDArray[Any]) -> NDArray[np.float32]:
    """Picture (h, w) or (h, w, 3: blue, green, red), 8 or 16 bits or float, as 0 to 1."""
    one = image if image.ndim == 2 else cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2GRAY)
    full = float(np.iinfo(one.dtype).max) if one.dtype.kind == "u" else 1.0
    return np.asarray(one.astype(np.float32) / full)


def find_marks(image: NDArray[Any], insert: Insert, lens: Lens, source: Path | str) -> SeenMarks:
    """Find the marks.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    insert : Insert
    lens : Lens
        Of pictures of this size.
    source : Path or str
        Named in messages.

    Raises
    ------
    PictureError
        When the picture is of another size than the lens', or shows fewer than `FEWEST` marks.
    """
    check_size(image, lens, source)
    grey = grey_picture(image)
    index, rough = _decoded(grey, insert)
    kept = _of_one_plane(rough, insert, index, lens)
    index, rough = index[kept], rough[kept]
    corners = edge_corners(grey, rough, lens.numbers) if len(rough) else None
    good = np.zeros(0, bool) if corners is None else corners.good
    if corners is None or good.sum() < FEWEST:
        raise PictureError(
            f"{source}: {int(good.sum())} marks of the insert are found ({FEWEST} wanted, of "
            f"{len(insert.marks)}): is the insert in view, sharp, evenly lit and not mirrored? Is "
            "it this one (--insert)? A mark wants 25 pixels or more across"
        )
    return SeenMarks(
        index[good],
        corners.corners[good],
        corners.u_px[good],
        corners.blur_px,
        float(np.median(corners.black[good])),
        float(np.median(corners.white[good])),
        corners.gamma,
    )


def check_size(image: NDArray[Any], lens: Lens, source: Path | str) -> None:
    """Refuse a picture of another size than the lens was calibrated at.

    Raises
    ------
    PictureError
    """
    if image.shape[1::-1] != lens.size_px:
        wide, high = lens.size_px
        raise PictureError(
            f"{source} has {image.shape[1]} x {image.shape[0]} px, and the camera was calibrated "
            f"at {wide} x {high}; take pictures at that setting, not cropped, resized or "
            "turned (a turn told by EXIF isn't made)"
        )


def _decoded(grey: NDArray[np.float32], insert: Insert) -> tuple[IntArray, FloatArray]:
    """Which marks OpenCV decodes, and their corners to about a pixel.

    In a smaller copy first; where it shows too few, in the picture as it is.
    """
    most: tuple[IntArray, FloatArray] = (np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    scale = min(1.0, _COARSE_PX / max(grey.shape))
    for shrunk in sorted({scale, 1.0}):
        size = (round(grey.shape[1] * shrunk), round(grey.shape[0] * shrunk))
        seen = grey if shrunk == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        low, high = np.percentile(seen[::4, ::4], [0.5, 99.5])
        eight = np.clip((seen - low) * (255 / max(float(high - low), 1e-6)), 0, 255)
        detected = _detected(eight.astype(np.uint8), insert)
        if len(detected[0]) > len(most[0]):
            ratio = np.array(grey.shape[::-1]) / np.array(size)
            most = detected[0], (detected[1] + 0.5) * ratio - 0.5
        if len(most[0]) >= 0.8 * len(insert.marks):
            break
    return most


def _detected(eight: NDArray[np.uint8], insert: Insert) -> tuple[IntArray, FloatArray]:
    asked = cv2.aruco.DetectorParameters()
    asked.adaptiveThreshWinSizeMax = 43
    asked.adaptiveThreshWinSizeStep = 20
    asked.minMarkerPerimeterRate = 0.015
    asked.perspectiveRemovePixelPerCell = 8
    book = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{DICTIONARY}"))
    corners, numbers, _ = cv2.aruco.ArucoDetector(book, asked).detectMarkers(eight)
    place = {number: n for n, number in enumerate(insert.numbers)}
    seen = Counter(map(int, np.ravel(numbers))) if numbers is not None else Counter()
    kept = {
        place[number]: np.asarray(corner, np.float64).reshape(4, 2)
        for number, corner in zip(map(int, np.ravel(numbers)), corners, strict=True)
        if number in place and seen[number] == 1
    } if seen else {}  # fmt: skip
    order = sorted(kept)
    return np.array(order, np.int64), np.array([kept[n] for n in order]).reshape(-1, 4, 2)


def _of_one_plane(
    rough: FloatArray, insert: Insert, index: IntArray, lens: Lens
) -> NDArray[np.bool_]:
    """Which marks lie where the others say, through any camera."""
    if len(rough) < FEWEST:
        return np.ones(len(rough), dtype=bool)
    plane = insert.corners()[index].reshape(-1, 2)
    flat = lens.straight_pixels(rough.reshape(-1, 2))
    back, _ = cv2.findHomography(flat, plane, cv2.RANSAC, _NEAR * max(insert.plate_mm))
    if back is None:
        return np.ones(len(rough), dtype=bool)
    laid = cv2.perspectiveTransform(flat[:, None], back)[:, 0]
    off = np.linalg.norm(laid - plane, axis=1).reshape(-1, 4).max(axis=1)
    return np.asarray(off < _NEAR * max(insert.plate_mm))
