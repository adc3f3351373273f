"""Measure printed line widths and open gaps in a microscope picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.devices.lens.perspective import mapped
from registration.devices.microscope.ink_absorption import MIDDLE, Shade, fit_shade
from registration.devices.microscope.picture import Picture, View
from registration.devices.microscope.profiles import (
    Profiles,
    ScanLine,
    middles,
    profiles_along,
    usual_height,
)

_MODELS: Final = 4
"""Lines whose mean profiles tell the picture's optics."""
_EVEN: Final = 0.05
_FEWEST_PLACES: Final = 5
_LEAST_OF_ALL: Final = 0.25
"""Of the usual height of all lines: less isn't ink."""
_SMOOTH: Final = 0.1
"""Of a width: a Gaussian's deviation, against noise."""


@dataclass(frozen=True)
class Line:
    """Printed line to be measured.

    Attributes
    ----------
    number : int
    points : (k, 2) float64, mm
    width_mm : float, mm
        Expected.
    reach_mm : float, mm
        To either side of it there is nothing else.
    step_mm : float, mm
        Between two places.
    """

    number: int
    points: FloatArray
    width_mm: float
    reach_mm: float
    step_mm: float


@dataclass(frozen=True)
class LineWidths:
    """Measured widths of one line.

    Attributes
    ----------
    line : Line
    way : ScanLine
    width_mm : (n,) float64, mm
        Diameter at each place; NaN where there is no ink.
    left_mm, right_mm : (n,) float64, mm
        Edges at half level, across from the line as designed.
    height : (n,) float64
        Of the ink over the ground, in the picture's units; NaN where there is none.
    inside : (n,) bool
        Whether the place lies in the picture.
    """

    line: Line
    way: ScanLine
    width_mm: FloatArray
    left_mm: FloatArray
    right_mm: FloatArray
    height: FloatArray
    inside: BoolArray

    @property
    def found(self) -> float:
        """Share of the line at which there is ink."""
        seen = self.inside.sum()
        return float(np.isfinite(self.width_mm).sum() / seen) if seen else 0.0


def measure_lines(
    picture: Picture, view: View, lines: Sequence[Line]
) -> tuple[list[LineWidths], Shade]:
    """Widths of all lines, and the optics by which half level was turned into diameter."""
    raw, profiles = [], []
    expected = [line.width_mm for line in lines]
    typical = float(np.median(expected))
    smooth = max(_SMOOTH * typical, 0.7e-3 * view.um_per_px)
    ways = [ScanLine.of(line.points, line.step_mm) for line in lines]
    # What is smoothed here is part of the blur that the optics are fitted with.
    across = [
        profiles_along(picture.ink, view.matrix, way, line.reach_mm).smoothed(smooth)
        for way, line in zip(ways, lines, strict=True)
    ]
    heights = [usual_height(*pair) for pair in zip(across, expected, strict=True)]
    least = _LEAST_OF_ALL * float(np.median(heights))
    for line, way, seen in zip(lines, ways, across, strict=True):
        middle, has_ink = middles(seen, line.width_mm, least)
        left, right, height = _edges(seen, middle, has_ink, line.width_mm)
        raw.append(LineWidths(line, way, right - left, left, right, height, seen.inside))
        profiles.append(_mean_profile(seen, (left + right) / 2, right - left))
    shade = replace(_optics(raw, profiles, view.um_per_px * 1e-3), smoothed_mm=smooth)
    return [replace(one, width_mm=shade.diameter(one.width_mm)) for one in raw], shade


def _edges(
    seen: Profiles, middle: FloatArray, has_ink: BoolArray, width_mm: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places left and right of the middle at which half of its height is passed; the height."""
    left, right, heights = (np.full(len(middle), np.nan) for _ in range(3))
    step, first = seen.step_mm, float(seen.across_mm[0])
    for k in np.flatnonzero(has_ink).tolist():
        profile, at = seen.values[k], (float(middle[k]) - first) / step
        wide = width_mm
        for _ in range(2):  # the middle's part follows from the width
            half = max(1, round(MIDDLE * wide / step))
            low = max(0, round(at) - half)
            height = float(profile[low : round(at) + half + 1].mean())
            edges = [_crossing(profile, at, height / 2, side) for side in (-1, 1)]
            if None in edges:
                break
            a, b = (float(edge) for edge in edges if edge is not None)
            at, wide = (a + b) / 2, (b - a) * step
        else:
            left[k], right[k], heights[k] = first + a * step, first + b * step, height
    return left, right, heights


def _crossing(profile: FloatArray, at: float, level: float, side: int) -> float | None:
    """Where the profile falls below a level going out from ``at``; in samples.

    Noise makes a first passage early and a last one late: their mean is neither.
    """
    start = min(max(round(at), 0), len(profile) - 1)
    out = profile[start:] if side > 0 else profile[start::-1]
    below = out < level
    first = int(below.argmax())
    if not below.any() or first == 0:
        return None
    # Another line's ink, farther out, isn't this one's: so far noise goes, and no farther.
    near = below[: first + max(2, first // 2)]
    last = len(near) - int(near[::-1].argmin()) if not near.all() else first
    passed = [
        k - 1 + float((out[k - 1] - level) / (out[k - 1] - out[k]))
        for k in (first, min(last, len(out) - 1))
        if out[k - 1] >= level > out[k]
    ]
    return start + side * float(np.mean(passed))


def _mean_profile(seen: Profiles, middle: FloatArray, width: FloatArray) -> FloatArray | None:
    """Mean of the profiles laid on their middles, where the line is as wide as it is mostly.

    Other widths would look like blur. None where too few were found.
    """
    usual = np.nanmedian(width) if np.isfinite(width).any() else np.nan
    rows = np.flatnonzero(np.abs(width - usual) < _EVEN * usual)
    if len(rows) < _FEWEST_PLACES:
        return None
    across, step = seen.across_mm, seen.step_mm
    at = (across + middle[rows, None] - across[0]) / step
    index = np.broadcast_to(np.arange(len(rows))[:, None], at.shape)
    laid = map_coordinates(seen.values[rows], [index, at], order=1, mode="nearest")
    return np.asarray(np.mean(laid, axis=0))


def _optics(
    raw: Sequence[LineWidths], profiles: Sequence[FloatArray | None], px_mm: float
) -> Shade:
    """From lines of all widths."""
    known = [k for k, profile in enumerate(profiles) if profile is not None]
    if not known:
        return Shade(1e3, px_mm / 2, 0.0)
    width = {k: float(np.nanmedian(raw[k].width_mm)) for k in known}
    reach = min(raw[k].line.reach_mm for k in known)
    known.sort(key=lambda k: width[k])
    pick = np.unique(np.linspace(0, len(known) - 1, _MODELS).round().astype(int))
    chosen = [known[k] for k in pick.tolist()]
    wide = max(profiles[k].shape[0] for k in chosen if profiles[k] is not None)
    across = np.linspace(-reach, reach, wide)
    cut = []
    for k in chosen:
        profile, own = profiles[k], raw[k].line.reach_mm
        assert profile is not None  # of those that are known
        cut.append(np.interp(across, np.linspace(-own, own, len(profile)), profile))
    return fit_shade(across, cut, [width[k] for k in chosen], px_mm)


_GAP_STEP_PX: Final = 0.25


@dataclass(frozen=True)
class Crossing:
    """A gap to be looked for.

    Attributes
    ----------
    number : int
    lines : (m, 2, 2) float64, mm
        Ways across it, each from the middle of one ink to the middle of the next.
    """

    number: int
    lines: FloatArray


@dataclass(frozen=True)
class GapWidth:
    """Measured width of one gap.

    Attributes
    ----------
    number : int
    open_mm : (m,) float64, mm
        On each way; 0 where it is closed, NaN outside the picture.
    """

    number: int
    open_mm: FloatArray


def measure_gaps(
    picture: Picture,
    view: View,
    gaps: Sequence[Crossing],
    contrast: float,
    wider_mm: float,
) -> list[GapWidth]:
    """How far each gap is open: how long the ways across it stay below half of the ink's height.

    Parameters
    ----------
    picture, view, gaps
    contrast : float
        Between ink and ground, in the picture's units; ink is what each way begins in.
    wider_mm : float, mm
        By how much a filament's diameter exceeds its width at half level.
    """
    widths = []
    for gap in gaps:
        wide = []
        inks = sample(picture.ink, view, gap.lines[:, 0])
        level = float(np.median(inks)) - contrast / 2
        for begin, end in gap.lines:
            length = float(np.hypot(*(end - begin)))
            steps = max(8, round(length / (view.um_per_px * 1e-3 * _GAP_STEP_PX)))
            seen = sample(picture.ink, view, np.linspace(begin, end, steps + 1))
            below = _open(seen, level) * length / steps
            wide.append(max(below - wider_mm, 0.0) if below > 0 else below)
        widths.append(GapWidth(gap.number, np.array(wide)))
    return widths


def _open(seen: FloatArray, level: float) -> float:
    """Steps for which a way between two inks lies below a level; crossings interpolated."""
    if not np.isfinite(seen).all():
        return float("nan")
    below = np.flatnonzero(seen < level)
    if not len(below):
        return 0.0
    first, last = int(below[0]), int(below[-1])
    begin, end = float(first), float(last)
    if first > 0:
        begin -= float((level - seen[first]) / (seen[first - 1] - seen[first]))
    if last < len(seen) - 1:
        end += float((level - seen[last]) / (seen[last + 1] - seen[last]))
    return end - begin


def sample(image: Float32Array, view: View, places: FloatArray) -> FloatArray:
    """Brightness at places (n, 2), mm; NaN outside the picture."""
    seen = mapped(view.matrix, places)
    u, v = seen.astype(np.float32).T[:, None, :]
    values = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
    high, wide = image.shape
    inside = ((seen >= 0) & (seen <= (wide - 1, high - 1))).all(axis=1)
    return np.where(inside, values, np.nan)
