"""Measure the open width of gaps between printed lines in a microscope picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray
from registration.devices.lens.perspective import mapped
from registration.devices.microscope.picture import FloatImage, Picture
from registration.devices.microscope.target import View

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


def sample(image: FloatImage, view: View, places: FloatArray) -> FloatArray:
    """Brightness at places (n, 2), mm; NaN outside the picture."""
    seen = mapped(view.matrix, places)
    u, v = seen.astype(np.float32).T[:, None, :]
    values = cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
    high, wide = image.shape
    inside = ((seen >= 0) & (seen <= (wide - 1, high - 1))).all(axis=1)
    return np.where(inside, values, np.nan)
