"""Refuse a found pattern position with very uneven scale, or with foreign ink in its frame."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.devices.lens.perspective import mapped, slopes
from registration.devices.microscope.picture import BoolImage, Picture
from registration.devices.microscope.target import Target
from registration.errors import PictureError

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
    ink: BoolImage = picture.small & (inside > 0)
    foreign = float((ink & (own == 0)).sum()) / max(float(ink.sum()), 1.0)
    if foreign > _MOST_FOREIGN:
        raise PictureError(
            f"{foreign:.0%} of the ink within the frame isn't where this pattern has lines "
            f"({_MOST_FOREIGN:.0%} at most): is it another pattern's picture (--pattern)?"
        )
