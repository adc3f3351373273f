"""Find a needle's tip in a picture: its pixel, diameter, and the end's tilt and roughness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame
from registration.devices.camera_frame.marks import check_size
from registration.devices.camera_frame.tip_fit import fit_end
from registration.devices.camera_frame.tip_patch import NeedleAxis, TipPatch, needle_axis, tip_patch
from registration.errors import PictureError

_COLUMNS: Final = 17
"""Across the needle."""
_INNER: Final = 0.84
"""Of its width that is looked at."""
_OUTER: Final = (1.5, 2.9)
"""Of half its width: ground beside it."""
_MOST: Final = 9.0
"""A deviation's square, of the ground's, beyond which it tells no more."""
_SHORT: Final = 1.5
"""Widths of needle and of ground that must be seen above and below its end."""
_LEAST_STEP: Final = 0.35
"""By which rows of needle deviate more than rows of ground."""


def rough_end(patch: TipPatch, axis: NeedleAxis, lowest: float, highest: float) -> float:
    """Height (px above the expected tip) from which on the strip isn't the ground; to half a width.

    Each row's mean square deviation from the ground is high on the needle and low below it: the
    step between is laid where it leaves the least sum of squares.

    Raises
    ------
    PictureError
        When needle and ground are alike, or no clear end is there.
    """
    heights = patch.above[1:-1]
    inner = np.linspace(-_INNER, _INNER, _COLUMNS) * patch.wide_px / 2
    side = np.linspace(*_OUTER, 9) * patch.wide_px / 2
    outer = np.concatenate([-side[::-1], side])
    seen, beside = (_sampled(patch.grey, patch, axis, heights, x) for x in (inner, outer))
    known = np.isfinite(seen).all(axis=1) & (np.isfinite(beside).sum(axis=1) > 4)
    heights, seen, beside = heights[known], seen[known], beside[known]
    if not known.any():
        raise PictureError("too little of the needle is in the picture around its tip")
    if patch.ground is None:
        level = np.nanmedian(beside, axis=1, keepdims=True)
        seen, beside = seen - level, beside - level
    else:
        seen = seen - _sampled(patch.ground, patch, axis, heights, inner)
        beside = beside - _sampled(patch.ground, patch, axis, heights, outer)
    noise = max(1.4826 * float(np.nanmedian(np.abs(beside - np.nanmedian(beside)))), 0.004)
    squares = np.nan_to_num(np.minimum((seen / noise) ** 2, _MOST**2))
    rows = np.log1p(squares).mean(axis=1)
    return _step(heights, rows, lowest, highest, _SHORT * patch.wide_px)


def _step(
    heights: FloatArray, rows: FloatArray, lowest: float, highest: float, short: float
) -> float:
    """Height of the step up between two levels that leaves the least sum of squares."""
    best, most, step = np.nan, np.inf, 0.0
    within = np.flatnonzero((heights >= lowest - short / 3) & (heights <= highest + short / 3))
    for at in within:
        # Long stretches of needle change; what lies near the end tells it.
        low = rows[(heights < heights[at]) & (heights > heights[at] - 3 * short)]
        high = rows[(heights >= heights[at]) & (heights < heights[at] + 3 * short)]
        if min(len(low), len(high)) < short / 3:
            continue
        left = (float(low.var()) * len(low) + float(high.var()) * len(high)) / len(
            np.concatenate([low, high])
        )
        rise = float(high.mean() - low.mean())
        if left - rise**2 / 4 < most and rise > 0:
            best, most, step = float(heights[at]), left - rise**2 / 4, rise
    if step < _LEAST_STEP:
        raise PictureError(
            "the needle's end isn't clear: what lies above and below is alike; put a plain ground "
            "of another brightness behind the tip, or give pictures with the needle at other places"
        )
    if not lowest < best < highest:
        raise PictureError(
            "the needle's end isn't within reach of where it should be; is the needle longer "
            "or bent, or its place (--tip-at) wrong? Raise --reach-mm"
        )
    return best


def _sampled(
    piece: FloatArray, patch: TipPatch, axis: NeedleAxis, heights: FloatArray, beside: FloatArray
) -> FloatArray:
    rows = np.broadcast_to((heights - patch.above[0])[:, None], (len(heights), len(beside)))
    columns = axis.beside + axis.lean * heights[:, None] + beside - patch.beside[0]
    return np.asarray(map_coordinates(piece, [rows, columns], order=1, cval=np.nan))


_FLOOR_ASIDE_PX: Final = 0.05
_FLOOR_UP_PX: Final = 0.1
"""No tip is known better: light on round steel shifts edges, and an end's rim isn't quite sharp."""


@dataclass(frozen=True, eq=False)
class SeenTip:
    """A tip in one picture.

    Attributes
    ----------
    pixel : (2,) float64
        Of the middle of the needle's end.
    covariance_px2 : (2, 2) float64
    width_mm, u_width_mm : float, mm
        Outer diameter above the end.
    slope, u_slope : float
        Of the end against straight across (tangent of the angle seen).
    rough : float
        RMS of the end about a flat one's ellipse, of the width.
    lean : float
        Tangent of the needle's angle seen against upright.
    clear : float
        Of the edges, over the ground's deviation.
    """

    pixel: FloatArray
    covariance_px2: FloatArray
    width_mm: float
    u_width_mm: float
    slope: float
    u_slope: float
    rough: float
    lean: float
    clear: float


def find_tip(
    image: NDArray[Any],
    frame: CameraFrame,
    tip_mm: FloatArray,
    outer_mm: float,
    *,
    reach_mm: float = 2.0,
    length_mm: float = 12.0,
    ground: NDArray[Any] | None = None,
    source: str = "the picture",
) -> SeenTip:
    """Find the tip of a needle that points down.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    frame : CameraFrame
    tip_mm : (3,) float64, mm
        Where the tip should be, printer's frame.
    outer_mm : float, mm
        The needle's outer diameter, by its profile.
    reach_mm : float, mm
        How far off the tip may be.
    length_mm : float, mm
        Of the needle below its hub.
    ground : (h, w) or (h, w, 3), optional
        The same scene without the needle, or with it elsewhere.
    source : str
        Named in messages.

    Raises
    ------
    PictureError
        When it isn't found; says why.
    """
    check_size(image, frame.lens, source)
    if ground is not None:
        check_size(ground, frame.lens, f"the ground of {source}")
    view = frame.under(None).view
    patch = tip_patch(
        image,
        view,
        np.asarray(tip_mm, np.float64),
        outer_mm,
        reach_mm,
        ground,
        length_mm,
        frame.seen.gamma,
    )
    far = reach_mm * patch.px_per_mm
    axis = needle_axis(patch, far)
    end = fit_end(patch, axis, rough_end(patch, axis, -far, far))
    turn = np.column_stack([patch.up, patch.aside])
    floor = np.diag([_FLOOR_UP_PX**2, _FLOOR_ASIDE_PX**2])
    return SeenTip(
        patch.pixel(end.above, end.beside),
        turn @ (end.covariance_px2 + floor) @ turn.T,
        end.wide_px / patch.px_per_mm,
        end.u_wide_px / patch.px_per_mm,
        end.tilt + end.lean,
        end.u_tilt,
        end.rough,
        end.lean,
        end.clear,
    )
