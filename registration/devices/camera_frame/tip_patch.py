"""Crop a picture around a needle's tip, and find the needle's axis there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import View, project
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
    view: View,
    tip_mm: FloatArray,
    outer_mm: float,
    reach_mm: float,
    ground: NDArray[Any] | None = None,
    length_mm: float = 12.0,
    gamma: float = 1.0,
) -> TipPatch:
    """Cut the piece in which the tip must lie.

    Parameters
    ----------
    image, ground : (h, w) or (h, w, 3)
        With the needle, and the same scene without it here.
    view : View
    tip_mm : (3,) float64, mm
        Where the tip should be, printer's frame.
    outer_mm : float, mm
        The needle's outer diameter.
    reach_mm : float, mm
        How far off it may be.
    length_mm : float, mm
        Of the needle below its hub.
    gamma : float
        Power of the pictures' values that is proportional to light: what is measured by areas under
        blurred steps must be that, or dark things look smaller.

    Raises
    ------
    PictureError
        When the camera looks along the needle, it is too thin in the picture, or out of it.
    """
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


_LEANS: Final = np.linspace(-0.08, 0.08, 65)
"""Tangents of the needle's angle against where it should point."""
_USUAL_LEAN: Final = 0.05
_WIDTHS: Final = (0.7, 1.35)
"""Of the expected width."""
_PLAY: Final = 0.04
"""Of the width, by which a needle's diameter and its look in a picture differ usually."""
_ENOUGH: Final = 15.0
"""Clearness beyond which an edge is no better."""
_FAINT: Final = 3.0
"""Clearness below which an edge isn't one."""
_SIDE_DIFFERENCE_WEIGHT: Final = 0.6
"""Weight of what is clear just outside the needle."""
_OTHER: Final = 13.0
"""Most that a width of another needle costs, in clearness."""
_GRID: Final = 0.25
_SAME: Final = 0.25
"""Of the width, up to which it may be the needle of the profile."""
_LEAST_CLEAR: Final = 5.0
"""Of an edge's gradient over the deviation of the others."""


@dataclass(frozen=True)
class NeedleAxis:
    """A needle in a patch, to a part of its width.

    Attributes
    ----------
    beside : float, px
        Of the axis, at row 0 (the expected tip's height).
    lean : float
        Pixels aside for each pixel up.
    """

    beside: float
    lean: float


def needle_axis(patch: TipPatch, lowest: float) -> NeedleAxis:
    """Find the needle in the rows from a height on, where it must be whatever the tip's place.

    Raises
    ------
    PictureError
        When no two edges of about the right distance stand out.
    """
    seen = patch.grey if patch.ground is None else patch.grey - patch.ground
    rows = (patch.above >= lowest) & (np.isfinite(seen).mean(axis=1) > 0.9)
    if rows.sum() < 2 * patch.wide_px:
        raise PictureError(
            "too little of the needle is in the picture above its tip; move it towards the middle"
        )
    part = np.nan_to_num(seen[rows], nan=float(np.nanmean(seen)))
    gradient = gaussian_filter1d(part, max(0.7, 0.06 * patch.wide_px), axis=1, order=1)
    heights = patch.above[rows]
    wide = patch.wide_px * (1 + patch.taper * float(heights.mean()))
    # Rims and threads of glare are parallel: upright, their gradients add up to most.
    upright = [_sheared(gradient, heights, lean).mean(axis=0) for lean in _LEANS]
    energy = [float((mean**2).sum()) for mean in upright]
    worth = np.array(energy) * np.exp(-((_LEANS / _USUAL_LEAN) ** 2) / 2)
    lean = float(_LEANS[worth.argmax()])
    best = _pair(upright[int(worth.argmax())], wide)
    if best.clear < _LEAST_CLEAR or not any(best.seen):
        clear = best.clear
        raise PictureError(
            f"the needle isn't found: no two edges {patch.wide_px:.0f} pixels apart stand out "
            f"({clear:.1f} of the ground's deviation, {_LEAST_CLEAR:g} wanted). Is it in view, in "
            "focus, of this diameter (--needle)? A plain ground behind it helps, or several "
            "pictures with the needle at places 5 mm apart"
        )
    return _refined(gradient, heights, patch, best, lean)


def _sheared(gradient: FloatArray, heights: FloatArray, lean: float) -> FloatArray:
    """Rows moved so that what leans stands upright."""
    columns = np.arange(gradient.shape[1])
    shift = heights * lean
    base = np.floor(shift).astype(np.int64)
    part = (shift - base)[:, None]
    index = np.clip(columns + base[:, None], 0, gradient.shape[1] - 2)
    rows = np.arange(len(gradient))[:, None]
    return np.asarray((1 - part) * gradient[rows, index] + part * gradient[rows, index + 1])


class _Pair(NamedTuple):
    """Two edges: clearness of the clearer one, columns, and whether each is seen."""

    clear: float
    left: float
    right: float
    seen: tuple[bool, bool]


def _pair(mean: FloatArray, wide: float) -> _Pair:
    """Best place of two edges: clear, of about the right distance, nothing as clear beside them.

    A rim that is as bright as the ground shows no edge: then the other one and the width tell.
    """
    size = np.abs(mean)
    noise = 1.4826 * float(np.median(size)) + 1e-9
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    peaks = peaks[size[peaks] > _FAINT * noise]
    at = np.array([_peak(size, int(peak)) for peak in peaks])
    value = np.minimum(size[peaks] / noise, _ENOUGH)
    play = max(1.5, 0.08 * wide)
    grid = np.arange(0, len(mean), _GRID)
    near = 1 - np.abs(grid[:, None] - at) / play
    worth = (np.maximum(near, 0.0) * value).max(axis=1, initial=0.0)
    beyond = np.array([0.0, *np.cumsum(value)])  # of peaks up to a place
    middle = np.arange(wide, len(mean) - wide, _GRID)
    best, most = (0.0, 0.0), -np.inf
    for ratio in np.arange(_WIDTHS[0], _WIDTHS[1], 0.01):
        half = ratio * wide / 2
        score = np.interp(middle - half, grid, worth) + np.interp(middle + half, grid, worth)
        for sign in (-1.0, 1.0):
            ends = [middle + sign * (half + play), middle + sign * (half + 0.7 * wide)]
            low, high = (beyond[np.searchsorted(at, end)] for end in ends)
            score = score - np.abs(high - low) * _SIDE_DIFFERENCE_WEIGHT
        score -= min(((ratio - 1) / _PLAY) ** 2 / 2, _OTHER)
        top = int(score.argmax())
        if score[top] > most:
            most, best = float(score[top]), (float(middle[top]), half)
    left, seen_left = _snapped(at, best[0] - best[1], play)
    right, seen_right = _snapped(at, best[0] + best[1], play)
    if seen_left != seen_right:
        if seen_left:
            right = left + wide
        else:
            left = right - wide
    columns = np.arange(len(mean))
    clear = max(float(np.interp(edge, columns, size)) for edge in (left, right)) / noise
    return _Pair(clear, left, right, (seen_left, seen_right))


def _snapped(peaks: FloatArray, at: float, play: float) -> tuple[float, bool]:
    """Nearest peak to a column, and whether there is one within the play."""
    off = np.abs(peaks - at)
    if not len(peaks) or off.min() > play:
        return at, False
    return float(peaks[off.argmin()]), True


def _peak(size: FloatArray, at: int) -> float:
    """Sub-pixel place of a maximum, by a parabola."""
    a, b, c = size[at - 1 : at + 2]
    bend = a - 2 * b + c
    return at + (0.5 * float((a - c) / bend) if bend < 0 else 0.0)


def _refined(
    gradient: FloatArray,
    heights: FloatArray,
    patch: TipPatch,
    pair: _Pair,
    lean: float,
) -> NeedleAxis:
    """Both edges by straight lines through stretches of rows."""
    stretches = np.array_split(np.arange(len(heights)), max(6, int(len(heights) // patch.wide_px)))
    upright = _sheared(gradient, heights, lean)
    edges = []
    for edge in (pair.left, pair.right):
        sign = np.sign(np.interp(edge, np.arange(upright.shape[1]), upright.mean(axis=0)))
        reach = max(2.0, 0.22 * patch.wide_px)
        columns = np.arange(
            int(max(edge - reach, 1)), int(min(edge + reach, upright.shape[1] - 2)) + 1
        )
        places, tops = [], []
        for rows in stretches:
            mean = sign * upright[rows].mean(axis=0)
            top = columns[int(mean[columns].argmax())]
            if mean[top] > 0 and 0 < top < len(mean) - 1:
                places.append(_peak(mean, int(top)))
                tops.append(heights[rows].mean())
        edges.append(_line(np.array(tops), np.array(places), edge))
    (a, slope_a), (b, slope_b) = edges
    if not pair.seen[0]:
        a, slope_a = b - patch.wide_px, slope_b
    if not pair.seen[1]:
        b, slope_b = a + patch.wide_px, slope_a
    if abs(b - a - patch.wide_px) > _SAME * patch.wide_px:
        # A thread of glare or the ground was taken for a rim; both together said where it is.
        a, b, slope_a, slope_b = pair.left, pair.right, 0.0, 0.0
    return NeedleAxis((a + b) / 2 + patch.beside[0], lean + (slope_a + slope_b) / 2)


def _line(heights: FloatArray, places: FloatArray, usual: float) -> tuple[float, float]:
    """Place at row 0, and slope, of a robust line."""
    good = np.ones(len(heights), dtype=bool)
    for _ in range(5):
        if good.sum() < 4:
            return usual, 0.0
        slope, at = np.polyfit(heights[good], places[good], 1)
        off = places - slope * heights - at
        spread = max(1.4826 * float(np.median(np.abs(off[good]))), 0.03)
        good = np.abs(off) < 3 * spread
    return float(at), float(slope)
