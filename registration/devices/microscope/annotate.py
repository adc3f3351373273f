"""Draw the found frame, line edges and gaps into a microscope picture, for checking by eye."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.lens.perspective import mapped
from registration.devices.microscope.picture import Picture, Target, View
from registration.devices.microscope.widths import Crossing, GapWidth, LineWidths

_FRAME: Final = (200, 120, 0)
_EDGE: Final = (0, 160, 0)
_LOST: Final = (0, 0, 255)
_OPEN: Final = (0, 140, 0)
_CLOSED: Final = (0, 0, 220)
_SHIFT: Final = 3
"""Drawing counts in eighths of a pixel."""


def annotated(
    picture: Picture,
    view: View,
    target: Target,
    lines: Sequence[LineWidths],
    gaps: Sequence[tuple[Crossing, GapWidth]],
) -> NDArray[np.uint8]:
    """Frame in blue, edges in green, places without ink in red, each with its number.

    Returns
    -------
    (h, w, 3) uint8
        Blue, green, red.
    """
    image = picture.seen.copy()
    thick = max(1, round(max(image.shape) / 1500))
    for side in target.sides:
        _path(image, mapped(view.matrix, side), _FRAME, thick)
    for one in lines:
        _edges(image, view, one, thick)
        _number(image, mapped(view.matrix, one.way.points[:1])[0], one.line.number, thick)
    for gap, width in gaps:
        colour = _OPEN if np.nanmedian(width.open_mm) > 0 else _CLOSED
        for way in gap.lines[:: max(1, len(gap.lines) - 1)]:
            _path(image, mapped(view.matrix, way), colour, thick)
        _number(image, mapped(view.matrix, gap.lines[-1].mean(axis=0)[None])[0],
                gap.number, thick)  # fmt: skip
    return image


def _edges(image: NDArray[np.uint8], view: View, one: LineWidths, thick: int) -> None:
    known = np.isfinite(one.width_mm)
    for edge in (one.left_mm, one.right_mm):
        places = one.way.points + np.where(known, edge, 0.0)[:, None] * one.way.normals
        seen = mapped(view.matrix, places)
        for run in np.split(np.arange(len(seen)), np.flatnonzero(np.diff(known)) + 1):
            if known[run[0]]:
                _path(image, seen[run], _EDGE, thick)
    for place in mapped(view.matrix, one.way.points[~known & one.inside]).tolist():
        cv2.circle(image, (round(place[0]), round(place[1])), 2 * thick, _LOST, -1)


def _path(
    image: NDArray[np.uint8], seen: FloatArray, colour: tuple[int, int, int], thick: int
) -> None:
    points = np.round(seen * 2**_SHIFT).astype(np.int32)
    cv2.polylines(image, [points], False, colour, thick, cv2.LINE_AA, _SHIFT)


def _number(image: NDArray[np.uint8], seen: FloatArray, number: int, thick: int) -> None:
    size = max(image.shape) / 1800
    place = (round(float(seen[0]) + 6 * thick), round(float(seen[1]) - 6 * thick))
    for colour, wide in (((255, 255, 255), 4 * thick), ((0, 0, 0), thick)):
        cv2.putText(
            image, f"{number}", place, cv2.FONT_HERSHEY_SIMPLEX, size, colour, wide, cv2.LINE_AA
        )
