"""Look for blobs on the lines of a profiler's map."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from registration.inspection.pictures.plane_map import PlaneMap
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.unseen.out_of_place import over_ink
from registration.inspection.values import Blob
from registration.inspection.widths.high_spots import high_spots

_BESIDE: Final = 0.25
"""Of a width beside lines, so far blobs on them are looked for: second reflections lie at feet."""


def blobs_on_lines(look: SeenLayer) -> tuple[Blob, ...]:
    """What stands over the ink of a profiler's map, on its lines or beside them."""
    if not look.work.flanks_lost or look.thickness_mm is None:
        return ()
    over = over_ink(look, look.thickness_mm)
    if over is None:
        return ()
    width_px = float(np.median(look.ways.width)) * look.work.px_per_mm
    side = 2 * round(_BESIDE * width_px) + 1
    near = cv2.dilate(look.masks.fresh, np.ones((side, side), np.uint8))
    place = PlaneMap.of(look.frame, look.moved, 1.0 / look.work.px_per_mm)
    hidden = look.work.hidden | look.work.bad
    return high_spots(over, near, hidden, look.thickness_mm, width_px, place)
