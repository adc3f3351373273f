"""Find a needle's two edges in a patch by gradients that add up along them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from registration.camera_frame.tip_patch import TipPatch
from registration.errors import PictureError

FloatArray = NDArray[np.float64]

_LEANS: Final = np.linspace(-0.08, 0.08, 65)
"""Tangents of the needle's angle against where it should point."""
_WIDTHS: Final = (0.7, 1.35)
"""Of the expected width."""
_LEAST_CLEAR: Final = 5.0
"""Of an edge's gradient over the deviation of the others."""


@dataclass(frozen=True)
class NeedleAxis:
    """A needle in a patch.

    Attributes
    ----------
    beside : float, px
        Of the axis, at row 0 (the expected tip's height).
    lean : float
        Pixels aside for each pixel up.
    wide_px : float
    u_px : float
        Standard uncertainty of each edge.
    clear : float
        Gradient of the weaker edge over the deviation of the others.
    """

    beside: float
    lean: float
    wide_px: float
    u_px: float
    clear: float


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
    # One bright thread (glare on the steel) may not outvote the edges.
    limit = 3 * np.median(np.abs(gradient), axis=None) + np.percentile(np.abs(gradient), 90)
    gradient = np.clip(gradient, -limit, limit)
    heights = patch.above[rows]
    best: tuple[float, float, float, float, FloatArray] | None = None
    for lean in _LEANS:
        mean = _sheared(gradient, heights, lean).mean(axis=0)
        found = _pair(mean, patch)
        if found is not None and (best is None or found[0] > best[0]):
            best = (*found, lean, mean)
    if best is None or best[0] < _LEAST_CLEAR:
        clear = 0.0 if best is None else best[0]
        raise PictureError(
            f"the needle isn't found: no two edges {patch.wide_px:.0f} pixels apart stand out "
            f"({clear:.1f} of the ground's deviation, {_LEAST_CLEAR:g} wanted). Is it in view, in "
            "focus, of this diameter (--needle)? A plain ground behind it helps, or several "
            "pictures with the needle at places 5 mm apart"
        )
    clear, left, right, lean, _ = best
    return _refined(gradient, heights, patch, left, right, lean, clear)


def _sheared(gradient: FloatArray, heights: FloatArray, lean: float) -> FloatArray:
    """Rows moved so that what leans stands upright."""
    columns = np.arange(gradient.shape[1])
    shift = heights * lean
    base = np.floor(shift).astype(np.int64)
    part = (shift - base)[:, None]
    index = np.clip(columns + base[:, None], 0, gradient.shape[1] - 2)
    rows = np.arange(len(gradient))[:, None]
    return np.asarray((1 - part) * gradient[rows, index] + part * gradient[rows, index + 1])


def _pair(mean: FloatArray, patch: TipPatch) -> tuple[float, float, float] | None:
    """Clearness and columns (sub-pixel) of the best two edges of about the right distance."""
    size = np.abs(mean)
    noise = 1.4826 * float(np.median(size)) + 1e-9
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:])) + 1
    peaks = peaks[size[peaks] > 2 * noise]
    best: tuple[float, float, float] | None = None
    worth = 0.0
    for n, left in enumerate(peaks):
        for right in peaks[n + 1 :]:
            ratio = (right - left) / patch.wide_px
            if not _WIDTHS[0] <= ratio <= _WIDTHS[1]:
                continue
            weaker = float(min(size[left], size[right])) / noise
            value = weaker * float(np.exp(-(((ratio - 1) / 0.25) ** 2) / 2))
            if value > worth:
                worth = value
                best = (weaker, _peak(size, int(left)), _peak(size, int(right)))
    return best


def _peak(size: FloatArray, at: int) -> float:
    """Sub-pixel place of a maximum, by a parabola."""
    a, b, c = size[at - 1 : at + 2]
    bend = a - 2 * b + c
    return at + (0.5 * float((a - c) / bend) if bend < 0 else 0.0)


def _refined(
    gradient: FloatArray,
    heights: FloatArray,
    patch: TipPatch,
    left: float,
    right: float,
    lean: float,
    clear: float,
) -> NeedleAxis:
    """Both edges by straight lines through stretches of rows."""
    stretches = np.array_split(np.arange(len(heights)), max(6, int(len(heights) // patch.wide_px)))
    upright = _sheared(gradient, heights, lean)
    edges = []
    for edge in (left, right):
        sign = np.sign(np.interp(edge, np.arange(upright.shape[1]), upright.mean(axis=0)))
        reach = max(2.0, 0.22 * patch.wide_px)
        columns = np.arange(int(max(edge - reach, 1)), int(min(edge + reach, upright.shape[1] - 2)) + 1)
        places, tops = [], []
        for rows in stretches:
            mean = sign * upright[rows].mean(axis=0)
            top = columns[int(mean[columns].argmax())]
            if mean[top] > 0 and 0 < top < len(mean) - 1:
                places.append(_peak(mean, int(top)))
                tops.append(heights[rows].mean())
        edges.append(_line(np.array(tops), np.array(places), edge))
    (a, slope_a, u_a), (b, slope_b, u_b) = edges
    return NeedleAxis(
        (a + b) / 2 + patch.beside[0],
        lean + (slope_a + slope_b) / 2,
        b - a,
        float(np.hypot(u_a, u_b) / np.sqrt(2)),
        clear,
    )


def _line(heights: FloatArray, places: FloatArray, usual: float) -> tuple[float, float, float]:
    """Place at row 0, slope, and uncertainty at row 0, of a robust line."""
    if len(heights) < 4:
        return usual, 0.0, 1.0
    good = np.ones(len(heights), dtype=bool)
    for _ in range(5):
        slope, at = np.polyfit(heights[good], places[good], 1)
        off = places - slope * heights - at
        spread = max(1.4826 * float(np.median(np.abs(off[good]))), 0.03)
        good = np.abs(off) < 3 * spread
        if good.sum() < 4:
            return usual, 0.0, 1.0
    terms = np.column_stack([heights[good], np.ones(good.sum())])
    inner = np.linalg.inv(terms.T @ terms)
    return float(at), float(slope), float(spread * np.sqrt(inner[1, 1]))
