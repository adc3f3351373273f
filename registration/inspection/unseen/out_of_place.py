"""Doubt gaps that another place of the layer would explain as well.

A move shifts both edges of a filled area, a missing line one: by most of a pitch it makes a missing
outermost line look like one that touches it. A gap counts where no ink is seen on it with the
layer at its designed place, too. Where a layer truly lies elsewhere (a turned map,
rows that were dropped), as much ink lies where none should be as seems to be missing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray
from registration.inspection.findings import LayerFindings
from registration.inspection.ink.presence import INK
from registration.inspection.pictures.working import Mask, drawn_lines
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.values import ExpectedLines, FloatImage, Gap, Unseen

_BY_HALF: Final = 0.5
_SPREAD: Final = 1.4
"""Times its width, to which a line's ink may spread."""
_LEAST_WIDE: Final = 0.5
"""Of a width: narrower ink is a line's own rim."""
_LEVEL: Final = (-0.4, 0.6)
"""Thicknesses from sound ink's level, between which a surface is the layer's ink."""
_FEWEST: Final = 60
_SAME_LEVEL: Final = 0.5
"""Thicknesses, by which ink of earlier looks at the same layer lies lower at most."""


def unless_elsewhere(found: LayerFindings, rival: LayerFindings) -> LayerFindings:
    """Return findings without the gaps on whose places ink is seen, with the layer at a rival one.

    They are in ``unplaced``, and their places count as not seen.
    """
    lost = tuple(gap for gap in found.gaps if _shows_ink(gap, rival))
    if not lost:
        return found
    s = found.stations
    rows = s.seen & np.any([s.within(gap) for gap in lost], axis=0)
    stations = replace(s, seen=s.seen & ~rows, why=np.where(rows, int(Unseen.UNCLEAR), s.why))
    less = float(s.length_mm[rows].sum() / s.length_mm.sum())
    return replace(
        found,
        stations=stations,
        gaps=tuple(gap for gap in found.gaps if gap not in lost),
        unplaced=lost,
        seen_share=max(found.seen_share - less, 0.0),
    )


def _shows_ink(gap: Gap, rival: LayerFindings) -> bool:
    """Whether ink is seen on half of a gap at least."""
    s = rival.stations
    own = s.within(gap)
    ink = own & s.seen & (s.present > INK)
    return bool(own.any() and s.length_mm[ink].sum() > _BY_HALF * s.length_mm[own].sum())


def ink_beside_mm(look: SeenLayer, lines: ExpectedLines, thickness_mm: float) -> float:
    """Way of a line whose ink lies at the layer's height where none of its lines does, mm.

    By the area of what is wider than half a line, beyond what lines may spread to.
    """
    over = over_ink(look, thickness_mm)
    if over is None:
        return 0.0
    ink = (over > _LEVEL[0]) & (over < _LEVEL[1]) & ~(look.work.hidden | look.work.bad)
    ink &= _own_lines(look, lines, thickness_mm) == 0
    width_px = float(np.median(look.ways.width)) * look.work.px_per_mm
    side = max(3, round(_LEAST_WIDE * width_px))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    wide = cv2.morphologyEx(ink.astype(np.uint8), cv2.MORPH_OPEN, disc)
    return float(cv2.countNonZero(wide)) / width_px / look.work.px_per_mm


def over_ink(look: SeenLayer, thickness_mm: float) -> FloatImage | None:
    """Heights over a plane through sound ink's, thicknesses, (h, w); None for too little ink."""
    assert look.work.height is not None
    level = _ink_level(look, thickness_mm)
    if level is None:
        return None
    return np.asarray(look.work.height / np.float32(thickness_mm) - level, dtype=np.float32)


def _own_lines(look: SeenLayer, lines: ExpectedLines, thickness_mm: float) -> Mask:
    """Where the layer's ink may lie, that of earlier looks at it included, (h, w)."""
    least = float(np.median(lines.end[lines.fresh, 2])) - _SAME_LEVEL * thickness_mm
    row = lines.fresh | (lines.end[:, 2] > least)
    by = np.append((look.moved.point - look.ways.point)[0, :2], 0.0)
    ends = [look.frame.to_pixels(one[row] + by) for one in (lines.start, lines.end)]
    wide = _SPREAD * lines.width_mm[row] * look.work.px_per_mm + 2.0
    return drawn_lines(look.work.shape, np.stack(ends, axis=1), wide)


def _ink_level(look: SeenLayer, thickness_mm: float) -> FloatImage | None:
    """Plane through sound ink's heights, thicknesses over the layer's middle, (h, w)."""
    assert look.work.height is not None
    shape, at = look.work.shape, np.rint(look.seen.at).astype(np.int64)
    inside = ((at >= 0) & (at < np.array(shape[::-1]))).all(axis=1)
    use: BoolArray = inside & (look.why == Unseen.SEEN) & (look.present > INK)
    if use.sum() < _FEWEST:  # too grainy for gaps, or under blobs
        use = inside & (np.nan_to_num(look.present) > INK)
    if use.sum() < _FEWEST:
        return None
    x, y = at[use].T
    height = look.work.height[y, x] / thickness_mm
    basis = np.column_stack([np.ones(len(x)), x, y])
    best = np.linalg.lstsq(basis, height, rcond=None)[0]
    near = np.abs(height - basis @ best) < _LEVEL[1]
    if near.sum() >= _FEWEST:
        best = np.linalg.lstsq(basis[near], height[near], rcond=None)[0]
    rows, columns = np.indices(shape)
    return np.asarray(best[0] + best[1] * columns + best[2] * rows, dtype=np.float32)
