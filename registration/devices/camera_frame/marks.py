"""Find an insert's ArUco marks in a picture, and measure their corners by edges."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from kernels.arrays import FloatArray, IntArray
from registration.devices.camera_frame.frame import bend, unbend
from registration.devices.camera_frame.insert import CELLS, DICTIONARY, Insert
from registration.devices.lens import Lens
from registration.errors import PictureError

# A corner that is looked for as a corner moves inwards with blur. An edge doesn't: profiles across
# it are symmetric. So each side's edge is measured at many places, a line is laid through them in
# the picture without the lens' distortion, and neighbouring lines are intersected.
_PLACES: Final = 32
"""Along a side."""
_DEEP: Final = 25
"""Samples of a profile."""
_REACH: Final = 0.6
"""To either side of an edge, of a cell: beyond lie the mark's bits, and its white border's end."""
_ENDS: Final = 0.25
"""Of a profile at both ends, whose mean is taken for black and white."""
_INNER: Final = 0.1
"""Of a side at both ends that is left out: corners are round."""
_LEAST_GOOD: Final = 0.6
"""Of a side's places that must lie on its line."""
_ROUNDS: Final = 2
_GAMMAS: Final = (0.7, 3.0)
_CODED: Final = 1.2
_SRGB: Final = 2.0
"""Power of most cameras' pictures (sRGB, Rec. 709), taken where edges tell more than `_CODED`: in
sharp pictures they tell too little, since values between pixels are means of coded ones."""
_FLOOR_PX: Final = 0.02
"""No corner is known better: quantised, compressed, of imperfect edges."""


@dataclass(frozen=True, eq=False)
class EdgedMarks:
    """Marks as their edges say.

    Attributes
    ----------
    good : (n,) bool
        Whether all four sides were found.
    corners : (n, 4, 2) float64, px
    u_px : (n,) float64
        Standard uncertainty of a corner along each axis.
    blur_px : float
        Deviation of the blur across an edge, the marks' median.
    black, white : (n,) float64
        Beside the edges.
    gamma : float
        Power of the picture's values that is proportional to light.
    """

    good: NDArray[np.bool_]
    corners: FloatArray
    u_px: FloatArray
    blur_px: float
    black: FloatArray
    white: FloatArray
    gamma: float


def edge_corners(grey: NDArray[Any], rough: FloatArray, lens: FloatArray) -> EdgedMarks:
    """Measure corners that are known to about a pixel.

    Parameters
    ----------
    grey : (h, w) float32
    rough : (n, 4, 2) float64, px
        In order around each mark.
    lens : (8,) float64
        As `Lens.numbers`.
    """
    corners, good = rough.copy(), np.ones(len(rough), dtype=bool)
    for _ in range(_ROUNDS):
        profiles, reach = _profiles(grey, corners)
        offset, level = _offsets(profiles, reach)
        corners, moved, fits = _intersected(corners, offset, lens)
        good &= fits
        corners = np.where(np.isfinite(corners), corners, rough)
    blur = _blur(profiles, reach, offset, good)
    gamma = _gamma(profiles[good], reach[good], offset[good], blur)
    return EdgedMarks(good, corners, np.maximum(moved, _FLOOR_PX), blur, level[0], level[1], gamma)


def _sides(corners: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places along the sides (n, 4, k, 2), outward normals (n, 4, 2), lengths (n, 4)."""
    along = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(along, axis=2)
    normal = np.stack([along[..., 1], -along[..., 0]], axis=-1) / length[..., None]
    middle = corners.mean(axis=1, keepdims=True)
    outwards = ((corners - middle) * normal).sum(axis=2, keepdims=True)
    normal = np.where(outwards < 0, -normal, normal)
    share = np.linspace(_INNER, 1 - _INNER, _PLACES)
    return corners[:, :, None] + share[:, None] * along[:, :, None], normal, length


def _profiles(grey: NDArray[Any], corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Grey across the edges from within to without (n, 4, k, m); how far, px (n, 4)."""
    places, normal, length = _sides(corners)
    reach = np.maximum(_REACH * length / CELLS, 2.0)
    steps = np.linspace(-1, 1, _DEEP) * reach[..., None]
    at = places[:, :, :, None] + steps[:, :, None, :, None] * normal[:, :, None, None]
    flat = at.astype(np.float32).reshape(-1, _DEEP, 2)
    seen = np.empty(flat.shape[:2], np.float32)
    for begin in range(0, len(flat), 16_384):  # a map of cv2.remap holds 32,767 rows at most
        part = flat[begin : begin + 16_384]
        seen[begin : begin + 16_384] = cv2.remap(
            grey, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    return seen.reshape(at.shape[:-1]).astype(np.float64), reach


def _offsets(
    profiles: FloatArray, reach: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """Edges' distances outwards, px (n, 4, k), NaN where there is none; black and white (n,).

    A profile that rises from 0 to 1 at e has the integral reach - e, whatever its blur.
    """
    few = max(2, int(_ENDS * _DEEP))
    black, white = profiles[..., :few].mean(axis=-1), profiles[..., -few:].mean(axis=-1)
    contrast = white - black
    usual = np.median(contrast, axis=(1, 2), keepdims=True)
    clear = (contrast > 0.4 * usual) & (usual > 0)
    unit = (profiles - black[..., None]) / np.where(clear, contrast, 1.0)[..., None]
    step = 2 * reach[..., None] / (_DEEP - 1)
    area = (unit[..., 1:-1].sum(axis=-1) + (unit[..., 0] + unit[..., -1]) / 2) * step
    offset = reach[..., None] - area
    offset[~clear | (np.abs(offset) > 0.9 * reach[..., None])] = np.nan
    return offset, (np.median(black, axis=(1, 2)), np.median(white, axis=(1, 2)))


def _intersected(
    corners: FloatArray, offset: FloatArray, lens: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """New corners (n, 4, 2), their uncertainty (n,), and whether all sides have lines."""
    places, normal, _ = _sides(corners)
    edges = places + np.nan_to_num(offset)[..., None] * normal[:, :, None]
    flat = unbend((edges.reshape(-1, 2) - lens[1:3]) / lens[0], lens).reshape(edges.shape)
    line, scatter, used = _lines(flat, np.isfinite(offset))
    meets = np.cross(line, np.roll(line, 1, axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        met = meets[..., :2] / meets[..., 2:]
    pixels = bend(met.reshape(-1, 2), lens).reshape(met.shape) * lens[0] + lens[1:3]
    # At a side's end a line is known half as well as amid it.
    u_px = 2 * lens[0] * np.sqrt((scatter**2 / np.maximum(used, 1)).mean(axis=1))
    near = np.linalg.norm(pixels - corners, axis=2).max(axis=1)
    limit = 0.12 * np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).min(axis=1) + 2
    fits = (used >= _LEAST_GOOD * _PLACES).all(axis=1) & (near < limit)
    return pixels, u_px, fits


def _lines(
    points: FloatArray, valid: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Lines (n, 4, 3) through points (n, 4, k, 2), Tukey's weights; scatter and points used."""
    weight = valid.astype(np.float64)
    for _ in range(6):
        total = np.maximum(weight.sum(axis=-1), 1e-9)[..., None]
        middle = (weight[..., None] * points).sum(axis=-2) / total
        apart = points - middle[..., None, :]
        spread = np.einsum("...k,...ki,...kj->...ij", weight, apart, apart)
        _, axes = np.linalg.eigh(spread)
        across = axes[..., 0]
        off = np.einsum("...ki,...i->...k", apart, across)
        usual = 1.4826 * np.nanmedian(np.where(valid, np.abs(off), np.nan), axis=-1, keepdims=True)
        far = off / np.maximum(4.7 * usual, 1e-12)
        weight = np.where(valid & (np.abs(far) < 1), (1 - np.minimum(far**2, 1)) ** 2, 0.0)
    line = np.concatenate([across, -(across * middle).sum(axis=-1, keepdims=True)], axis=-1)
    return line, usual[..., 0], (weight > 0.1).sum(axis=-1)


def _blur(
    profiles: FloatArray, reach: FloatArray, offset: FloatArray, good: NDArray[np.bool_]
) -> float:
    """Deviation of the blur by the steepest slope of mean profiles: contrast / (√(2π) slope)."""
    if not good.any():
        return float("nan")
    mean = profiles[good].mean(axis=2)
    slope = np.diff(mean, axis=-1).max(axis=-1) / (2 * reach[good] / (_DEEP - 1))
    few = max(2, int(_ENDS * _DEEP))
    contrast = mean[..., -few:].mean(axis=-1) - mean[..., :few].mean(axis=-1)
    return float(np.median(contrast / np.maximum(slope, 1e-9)) / np.sqrt(2 * np.pi))


def _gamma(profiles: FloatArray, reach: FloatArray, offset: FloatArray, blur: float) -> float:
    """Power of the picture's values whose mean profile across the edges is symmetric.

    Lenses blur light, which most cameras store as a power of about 1/2: then a blurred edge is
    steeper in the dark. 1 where it isn't.
    """
    if not len(profiles):
        return 1.0
    far = min(3.0 * blur + 1.0, 0.7 * float(np.median(reach)))
    away = np.linspace(-far, far, 4 * _DEEP + 1)
    at = offset[..., None] + away
    place = (at / reach[..., None, None] + 1) / 2 * (_DEEP - 1)
    base = np.clip(np.nan_to_num(place).astype(np.int64), 0, _DEEP - 2)
    low = np.take_along_axis(profiles, base, axis=-1)
    seen = low + (place - base) * (np.take_along_axis(profiles, base + 1, axis=-1) - low)
    inside = np.isfinite(place).all(axis=-1) & (np.abs(place - (_DEEP - 1) / 2) < _DEEP / 2).all(-1)
    white = profiles[..., -2:].mean(axis=-1)
    kept = inside & (white > 0)
    if kept.sum() < _PLACES:
        return 1.0
    mean = np.median(seen[kept] / white[kept][:, None], axis=0)
    try:
        even = float(brentq(lambda power: _skew(mean, away, power), *_GAMMAS, xtol=1e-3))
    except ValueError:  # no change of sign between them
        return 1.0
    return _SRGB if even > _CODED else 1.0


def _skew(profile: FloatArray, away: FloatArray, power: float) -> float:
    """Third moment of a step's slope about its middle, of values to a power."""
    light = np.maximum(profile, 0.0) ** power
    slope = np.diff(light) / (light[-1] - light[0])
    middle = (away[1:] + away[:-1]) / 2
    return float((slope * (middle - (slope * middle).sum()) ** 3).sum())


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
            f"{source}: {int(good.sum())} marks of the fiducial plate are found ({FEWEST} wanted, "
            f"of {len(insert.marks)}): is the fiducial plate in view, sharp, evenly lit and not "
            "mirrored? Is it this one (--insert)? A mark wants 25 pixels or more across"
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
