"""Find a needle's axis in a picture patch from its two edges, by gradients summed along them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from kernels.arrays import FloatArray
from registration.devices.camera_frame.tip_patch import TipPatch
from registration.errors import PictureError

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
_BESIDE: Final = 0.6
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
            score = score - np.abs(high - low) * _BESIDE
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
