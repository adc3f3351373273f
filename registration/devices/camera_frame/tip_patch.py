"""Crop a picture around a needle's tip, upright along the needle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame, project
from registration.devices.camera_frame.marks import grey_picture
from registration.errors import PictureError

_LEAST_ANGLE: Final = 0.2
"""Sine of the smallest angle between the view and the needle."""
_LEAST_PX: Final = 5.0
"""Width of the needle in the picture."""
_ABOVE: Final = 14.0
"""Diameters of needle that are looked at above the highest place of the tip."""
_HIGH_MM: Final = 3.0
_BELOW_HUB: Final = 0.85
_SHORTEST: Final = 3.0
"""Diameters of needle that must be seen wherever the tip is."""
_GROUND_MARGIN_WIDTHS: Final = 3.0


@dataclass(frozen=True, eq=False)
class TipPatch:
    """A piece of a picture; rows go up the needle, columns to its side, a pixel of picture each.

    Attributes
    ----------
    grey : (k, m) float64
        0 to 1; NaN out of the picture.
    ground : (k, m) float64, or None
        The same piece without needle.
    origin_px, up, aside : (2,) float64
        Pixel of row and column 0, and the steps to the next row and column.
    above : (k,) float64, px
        Rows' distance from the expected tip up the needle.
    beside : (m,) float64, px
    px_per_mm : float
        Across the needle.
    wide_px : float
        Width of the needle, as expected.
    taper : float
        Share by which the needle looks wider a row farther up: it comes nearer to the camera.
    end_px : float
        How far the end's ellipse reaches beyond its middle, as expected.
    """

    grey: FloatArray
    ground: FloatArray | None
    origin_px: FloatArray
    up: FloatArray
    aside: FloatArray
    above: FloatArray
    beside: FloatArray
    px_per_mm: float
    wide_px: float
    taper: float
    end_px: float

    def pixel(self, above: float, beside: float) -> FloatArray:
        """Pixel (2,) of the picture."""
        return np.asarray(
            self.origin_px
            + (above - self.above[0]) * self.up
            + (beside - self.beside[0]) * self.aside
        )


def tip_patch(
    image: NDArray[Any],
    frame: CameraFrame,
    tip_mm: FloatArray,
    outer_mm: float,
    reach_mm: float,
    ground: NDArray[Any] | None = None,
    length_mm: float = 12.0,
) -> TipPatch:
    """Cut the piece in which the tip must lie.

    Parameters
    ----------
    image, ground : (h, w) or (h, w, 3)
        With the needle, and the same scene without it here.
    frame : CameraFrame
        Whose power of the pictures' values is proportional to light: what is measured by areas
        under blurred steps must be that, or dark things look smaller.
    tip_mm : (3,) float64, mm
        Where the tip should be, printer's frame.
    outer_mm : float, mm
        The needle's outer diameter.
    reach_mm : float, mm
        How far off it may be.
    length_mm : float, mm
        Of the needle below its hub.

    Raises
    ------
    PictureError
        When the camera looks along the needle, it is too thin in the picture, or out of it.
    """
    view, gamma = frame.under(None).view, frame.seen.gamma
    eye = view.eye_mm - tip_mm
    ray = eye / np.linalg.norm(eye)
    sine = float(np.hypot(ray[0], ray[1]))
    if sine < _LEAST_ANGLE:
        raise PictureError(
            f"the camera looks along the needle ({np.degrees(np.arcsin(sine)):.0f} degrees from "
            f"it, {np.degrees(np.arcsin(_LEAST_ANGLE)):.0f} wanted): tilt it, or take one from "
            "aside"
        )
    side = np.array([-ray[1], ray[0], 0.0]) / sine
    places = tip_mm + np.array([0 * side, 0.1 * side, [0, 0, 0.1], -0.1 * side])
    middle, one, up, other = project(view, places)
    px_per_mm = float(np.linalg.norm(one - other) / 0.2)
    up = (up - middle) / np.linalg.norm(up - middle)
    aside = np.array([-up[1], up[0]])
    high = project(view, tip_mm + np.array([0 * side, 0.1 * side, -0.1 * side]) + [0, 0, _HIGH_MM])
    nearer = float(np.linalg.norm(high[1] - high[2]) / 0.2) / px_per_mm - 1
    taper = nearer / float(np.linalg.norm(high[0] - middle))
    wide = outer_mm * px_per_mm
    if wide < _LEAST_PX:
        raise PictureError(
            f"the needle of {outer_mm:g} mm is {wide:.1f} pixels wide in the picture "
            f"({_LEAST_PX:g} wanted); come nearer, or use more pixels"
        )
    far = reach_mm * px_per_mm
    highest = _highest(far, wide, length_mm * sine * px_per_mm, sine)
    above = np.arange(-far - 2 * wide, highest)
    beside = np.arange(-far - _GROUND_MARGIN_WIDTHS * wide, far + _GROUND_MARGIN_WIDTHS * wide + 1)
    origin = middle + above[0] * up + beside[0] * aside
    at = middle + above[:, None, None] * up + beside[:, None] * aside
    grey = _cut(image, at, gamma)
    if np.isnan(grey).mean() > 0.6:
        raise PictureError(
            f"the tip should be at pixel {middle[0]:.0f}, {middle[1]:.0f}, at the picture's border "
            "or out of it; move the needle into the view, or give its place (--tip-at)"
        )
    cut = None if ground is None else _alike(_cut(ground, at, gamma), grey)
    rim = wide / 2 * abs(float(ray[2]))
    return TipPatch(
        grey, cut, origin, up, aside, above, beside, px_per_mm, wide, taper, rim
    )  # fmt: skip


def _highest(far: float, wide: float, long: float, sine: float) -> float:
    """How far up the needle is looked at, px; it ends at its hub.

    Raises
    ------
    PictureError
        When too little is left of it, wherever the tip may be.
    """
    highest = min(far + _ABOVE * wide, _BELOW_HUB * long)
    if highest < far + _SHORTEST * wide:
        raise PictureError(
            "too little of the needle is seen from so far above "
            f"({np.degrees(np.arcsin(sine)):.0f} degrees from it) to look for its tip within "
            f"{far / wide:.1f} of its diameters; lower --reach-mm, or tilt the camera more"
        )
    return highest


def _cut(image: NDArray[Any], at: FloatArray, gamma: float) -> FloatArray:
    """Light of a picture at pixels (k, m, 2), 0 to 1; NaN out of it."""
    low = np.maximum(np.floor(at.reshape(-1, 2).min(axis=0)).astype(int) - 3, 0)
    high = np.ceil(at.reshape(-1, 2).max(axis=0)).astype(int) + 4
    part = image[low[1] : max(high[1], low[1] + 1), low[0] : max(high[0], low[0] + 1)]
    if min(part.shape[:2]) < 2:
        return np.full(at.shape[:2], np.nan)
    grey = grey_picture(np.ascontiguousarray(part)) ** np.float32(gamma)
    own = (at - low).astype(np.float32)
    seen = cv2.remap(grey, own[..., 0], own[..., 1], cv2.INTER_CUBIC,
                     borderMode=cv2.BORDER_REPLICATE).astype(np.float64)  # fmt: skip
    wide, high_px = image.shape[1], image.shape[0]
    outside = (at < -0.5).any(axis=-1) | (at[..., 0] > wide - 0.5) | (at[..., 1] > high_px - 0.5)
    seen[outside] = np.nan
    return seen


def _alike(ground: FloatArray, grey: FloatArray) -> FloatArray:
    """The ground with the picture's light: a robust gain and offset."""
    valid = np.isfinite(ground) & np.isfinite(grey)
    a, b = ground[valid], grey[valid]
    gain, offset = 1.0, 0.0
    for _ in range(5):
        off = b - gain * a - offset
        usual = 1.4826 * np.median(np.abs(off - np.median(off))) + 1e-4
        near = np.abs(off - np.median(off)) < 2.5 * usual
        if near.sum() < 50 or np.std(a[near]) < 0.01:
            offset = float(np.median(b - a))
            return ground + offset
        gain, offset = map(float, np.polyfit(a[near], b[near], 1))
    return np.asarray(gain * ground + offset)
