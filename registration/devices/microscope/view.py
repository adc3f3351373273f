"""Find a printed calibration pattern in a picture by its frame, and check it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray
from registration.devices.lens.perspective import mapped, slopes
from registration.devices.microscope.picture import Picture, Target, View
from registration.devices.microscope.profiles import ScanLine, middles, profiles_along
from registration.errors import PictureError

_CANDIDATES: Final = 4
_CLOSINGS: Final = (0.004, 0.015)
"""Of the picture's side: a frame may be broken."""
THINNEST_PX: Final = 3.0
"""Width of the frame's lines, full size; thinner ones can't be measured."""


def first_views(picture: Picture, target: Target) -> Iterator[FloatArray]:
    """Affine views that lay the L on each of the largest things, both ways round."""
    x, y = target.size_mm
    model = np.array([[0, y, 1], [0, 0, 1], [x, 0, 1]], dtype=np.float64)
    for closing in _CLOSINGS:
        for pixels in _largest(picture.small.astype(np.uint8), closing):
            ends = _ell(pixels)
            if ends is None:
                continue
            for order in ((0, 1, 2), (2, 1, 0)):
                seen = (ends[list(order)] + 0.5) / picture.shrunk - 0.5
                view = np.vstack([np.linalg.solve(model, seen).T, [0, 0, 1]])
                # A speck would hold all of a pattern that is small enough.
                if target.width_mm * np.sqrt(abs(np.linalg.det(view))) >= THINNEST_PX:
                    yield view


def _largest(mask: NDArray[np.uint8], closing: float) -> Iterator[FloatArray]:
    """Pixels (n, 2) of the largest things, breaks up to a part of the picture closed."""
    side = max(3, round(max(mask.shape) * closing) | 1)
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    extent = np.hypot(stats[1:, cv2.CC_STAT_WIDTH], stats[1:, cv2.CC_STAT_HEIGHT])
    for label in (np.argsort(-extent)[:_CANDIDATES] + 1).tolist():
        yield np.argwhere(labels == label)[:, ::-1].astype(np.float64)


def _ell(pixels: FloatArray) -> FloatArray | None:
    """End, corner and other end of an L, (3, 2) px; None of something too small or straight."""
    if len(pixels) < 20:
        return None
    begin = pixels[np.argmax(np.hypot(*(pixels - pixels.mean(axis=0)).T))]
    for _ in range(3):
        end = pixels[np.argmax(np.hypot(*(pixels - begin).T))]
        begin, end = end, begin
    way = end - begin
    length = float(np.hypot(*way))
    if length < 10:
        return None
    across = np.abs((pixels - begin) @ np.array([-way[1], way[0]])) / length
    if across.max() < 0.1 * length:
        return None
    return np.array([begin, pixels[np.argmax(across)], end])


_MOST_FOREIGN: Final = 0.4
"""Of the ink in the frame that may lie beside the pattern."""
_UNEVEN: Final = 0.08
"""Difference of the scales along x and y, or cosine between them: a camera tilted by more."""


def check_scales(target: Target, matrix: FloatArray) -> None:
    """A camera looks down nearly straight; a very uneven view is of another rectangle."""
    x, y = target.size_mm
    slope = slopes(matrix, np.array([[x, y]]) / 2)[0]
    along = np.hypot(*slope)
    uneven = abs(float(along[0] / along[1]) - 1.0)
    skew = abs(float(slope[:, 0] @ slope[:, 1] / (along[0] * along[1])))
    if max(uneven, skew) > _UNEVEN:
        raise PictureError(
            f"the frame that is found isn't {x:g} by {y:g} mm seen from above (scales along its "
            f"sides differ by {uneven:.0%}, its angle is off by {np.degrees(skew):.0f} degrees): "
            "is it another pattern's picture (--pattern)? Else hold the camera straight"
        )


def check_foreign(picture: Picture, target: Target, matrix: FloatArray) -> None:
    """Ink within the frame that isn't this pattern's."""
    high, wide = picture.small.shape
    x, y = target.size_mm
    corners = np.array([[0, 0], [x, 0], [x, y], [0, y]], dtype=np.float64)

    def small(places: FloatArray) -> FloatArray:
        return (mapped(matrix, places) + 0.5) * picture.shrunk - 0.5

    inside = np.zeros((high, wide), np.uint8)
    cv2.fillPoly(inside, [np.round(small(corners)).astype(np.int32)], 1)
    own = np.zeros((high, wide), np.uint8)
    px = picture.shrunk * float(np.sqrt(abs(np.linalg.det(slopes(matrix, corners[:1])[0]))))
    radius = max(2, round(1.6 * target.width_mm * px))
    for u, v in np.round(small(target.points)).astype(np.int64).tolist():
        cv2.circle(own, (u, v), radius, 1, -1)
    ink: BoolArray = picture.small & (inside > 0)
    foreign = float((ink & (own == 0)).sum()) / max(float(ink.sum()), 1.0)
    if foreign > _MOST_FOREIGN:
        raise PictureError(
            f"{foreign:.0%} of the ink within the frame isn't where this pattern has lines "
            f"({_MOST_FOREIGN:.0%} at most): is it another pattern's picture (--pattern)?"
        )


LEAST_ON_INK: Final = 0.6
"""Of the pattern's points that must lie on ink in the first view."""
LEAST_SIDES: Final = 0.6
"""Of the places along each side at which its ink must be found."""
_ENOUGH: Final = 0.9
"""On ink: no other view is looked at."""
_FIRST: Final = (0.6, 0.9)
_THEN: Final = (0.5, 0.35)
"""How far to either side of a frame's side is looked, of the frame's margin: at first, then."""


def find_view(picture: Picture, target: Target) -> View:
    """Find the pattern.

    Raises
    ------
    PictureError
        When no frame is there, or what is in it isn't this pattern.
    """
    share, matrix = 0.0, np.eye(3)
    for tried in _bent_views(picture, target):
        on_ink = _on_ink(picture, tried, target)
        if on_ink > share:
            share, matrix = on_ink, tried
        if share > _ENOUGH:
            break
    if share < LEAST_ON_INK:
        raise PictureError(
            "the pattern isn't found in the picture: at the best place "
            f"{share:.0%} of it lies on ink ({LEAST_ON_INK:.0%} wanted). Have the whole frame in "
            "the picture and nothing larger (crop the dish's rim); is it this pattern's picture "
            f"(--pattern), with {THINNEST_PX:g} pixels or more across a line? With the frame's "
            "corners marked by hand (--marks) it needn't be found"
        )
    return refine_view(picture, target, matrix)


def marked_view(picture: Picture, target: Target, marks_px: FloatArray) -> View:
    """Of the frame's corners as marked: lower left, lower right, upper right, upper left, (4, 2).

    Raises
    ------
    PictureError
        When no pattern lies there.
    """
    return refine_view(picture, target, _through(target, marks_px))


def refine_view(picture: Picture, target: Target, matrix: FloatArray) -> View:
    """Fit the homography to the middles of the frame's ink, looking from afar, then near.

    Raises
    ------
    PictureError
        When a side of the frame isn't there, or the view is of something else.
    """
    for part in _THEN:
        matrix, off = _nearer(picture, target, matrix, part)
    check_scales(target, matrix)
    check_foreign(picture, target, matrix)
    middle = np.array([target.size_mm]) / 2
    slope = slopes(matrix, middle)[0]
    determinant = float(np.linalg.det(slope))
    # Pixels count downwards: seen from above, x and y up turn into the left-handed u and v.
    return View(
        matrix,
        determinant > 0,
        1e3 / float(np.sqrt(abs(determinant))),
        off,
        _on_ink(picture, matrix, target),
    )


def _bent_views(picture: Picture, target: Target) -> Iterator[FloatArray]:
    """First views, as they are and fitted to the frame, from as far as its margin lets.

    Three corners say nothing of perspective: the fourth may be so far off that a frame's side is
    out of a small reach, or another line within a large one.
    """
    for first in first_views(picture, target):
        yield first
        for part in _FIRST:
            try:
                yield _nearer(picture, target, first, part)[0]
            except PictureError:  # no frame there
                continue


def _nearer(
    picture: Picture, target: Target, matrix: FloatArray, part: float
) -> tuple[FloatArray, float]:
    """One round: measure the sides' middles within a part of the margin, and fit."""
    reach = max(part * target.margin_mm, 1.5 * target.width_mm)
    pixels, side = _side_middles(picture, target, matrix, reach, 1.0 if part == _THEN[-1] else 3.0)
    return _fitted(target, pixels, side)


def _on_ink(picture: Picture, matrix: FloatArray, target: Target) -> float:
    """Share of the pattern's points on ink or a pixel beside it, in the small copy."""
    seen = mapped(matrix, target.points)
    at = np.round((seen + 0.5) * picture.shrunk - 0.5).astype(np.int64)
    high, wide = picture.small.shape
    inside = (at >= 1).all(axis=1) & (at[:, 0] < wide - 1) & (at[:, 1] < high - 1)
    u, v = at[inside].T
    near = np.zeros(len(u), dtype=bool)
    for du in (-1, 0, 1):
        for dv in (-1, 0, 1):
            near |= picture.small[v + dv, u + du]
    return float(near.sum()) / len(at)


def _side_middles(
    picture: Picture,
    target: Target,
    matrix: FloatArray,
    reach: float,
    coarse: float,
) -> tuple[FloatArray, FloatArray]:
    """Pixels of the middles of the ink along the four sides, (n, 2), and which side, (n,)."""
    pixels, which = [], []
    for number, side in enumerate(target.sides):
        # A corner is seen from both sides, and an end is round: a little is left out.
        inner = side[0] + np.array([[0.06], [0.94]]) * (side[1] - side[0])
        way = ScanLine.straight(inner[0], inner[1], max(target.width_mm, 0.2))
        seen = profiles_along(picture.ink, matrix, way, reach, coarse)
        at, has_ink = middles(seen, target.width_mm)
        if has_ink.mean() < LEAST_SIDES:
            name = ("left", "bottom", "right", "top")[number]
            raise PictureError(
                f"the frame's {name} side is found at {has_ink.mean():.0%} of its length "
                f"({LEAST_SIDES:.0%} wanted): is it the picture of this pattern (--pattern), "
                "with the whole frame in it, in focus?"
            )
        places = way.points[has_ink] + at[has_ink, None] * way.normals[has_ink]
        pixels.append(mapped(matrix, places))
        which.append(np.full(int(has_ink.sum()), float(number)))
    return np.concatenate(pixels), np.concatenate(which)


def _fitted(target: Target, pixels: FloatArray, side: FloatArray) -> tuple[FloatArray, float]:
    """View by the lines through the four sides' middles, in mm how far off the middles stay."""
    lines = []
    for number in range(4):
        points = pixels[side == number].astype(np.float32)
        u, v, u0, v0 = cv2.fitLine(points, cv2.DIST_L12, 0, 1e-3, 1e-4).ravel().astype(float)
        lines.append((-v, u, v * u0 - u * v0))
    corners = np.cross(lines, np.roll(lines, -1, axis=0))
    matrix = _through(target, corners[:, :2] / corners[:, 2:])
    back = mapped(np.asarray(np.linalg.inv(matrix), dtype=np.float64), pixels)
    x, y = target.size_mm
    index = side.astype(np.int64)
    off = back[np.arange(len(back)), index % 2] - np.array([0.0, 0.0, x, y])[index]
    return matrix, float(np.sqrt(np.median(off**2) * 2.198))


def _through(target: Target, corners_px: FloatArray) -> FloatArray:
    """View by the frame's corners: lower left, lower right, upper right, upper left, (4, 2)."""
    x, y = target.size_mm
    corners = np.array([[0, 0], [x, 0], [x, y], [0, y]], dtype=np.float32)
    return np.asarray(cv2.getPerspectiveTransform(corners, corners_px.astype(np.float32)))
