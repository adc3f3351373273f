"""Propose first positions of a printed pattern: its L-shaped corner laid on the largest objects."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.microscope.picture import Picture
from registration.devices.microscope.target import Target

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
