"""Give a layer's first shift by its line areas; if unclear, all of the search range."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from registration.inspection.options import SeeingOptions
from registration.inspection.pictures.light import flattened
from registration.inspection.pictures.working import Masks, Working, WorkingFrame
from registration.inspection.place.coarse_shift import coarse_shift
from registration.inspection.values import ExpectedLines, Shift
from registration.inspection.ways import Ways

_LEAST_FREE: Final = 0.25
"""Of the fresh lines' area, beside older ink: less, and they don't tell where they lie."""

_LEAST_SPREAD: Final = 0.1
"""Of heights beside lines, thicknesses."""


def first_shift(
    work: Working, frame: WorkingFrame, lines: ExpectedLines, ways: Ways, options: SeeingOptions
) -> Shift:
    """Return the shift by the lines' areas; all within reach where they don't tell it."""
    reach = options.shift_mm
    unknown = Shift(0.0, 0.0, reach**2 * np.eye(2))
    middle = ways.point.mean(axis=0)
    at = frame.to_pixels(np.array([middle, middle + (0.5, 0, 0), middle + (0, 0.5, 0)]))
    slope = 2.0 * (at[1:] - at[0]).T  # px/mm
    x, y = np.ceil(reach * np.linalg.norm(slope, axis=1)).astype(int).tolist()
    if min(x, y) < 1:
        return unknown
    masks = Masks.of(lines, frame, work, np.zeros(2))
    flat = flattened(work.channels, masks.free, masks.core, work.px_per_mm, local=False)
    # Older lines of the same ink fit as well, half a pitch aside; a layer's own slab has none.
    older = cv2.dilate(masks.old, np.ones((5, 5), np.uint8)) > 0
    older &= work.height is None
    blocked = (work.bad | work.hidden | older).astype(np.uint8)
    if cv2.countNonZero(masks.fresh * (1 - blocked)) < _LEAST_FREE * cv2.countNonZero(masks.fresh):
        return unknown
    # The ground beside lines hardly scatters in heights: any rise there would count as a line does.
    least = 0.0 if work.height is None else _LEAST_SPREAD
    by_px = coarse_shift(flat, masks.fresh, blocked, (x, y), least)
    if by_px is None:
        return unknown
    by_mm = np.linalg.solve(slope, by_px)
    u = 1.0 / work.px_per_mm + 0.1 * float(np.median(ways.width))
    return Shift(float(by_mm[0]), float(by_mm[1]), u**2 * np.eye(2))
