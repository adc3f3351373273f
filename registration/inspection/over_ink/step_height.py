"""Detect missing ink on older ink in a height map, by a step down of one layer.

The level of sound ink is a smooth surface through the higher part of the layer's own heights, since
a frame's z, an evenly swollen gel or a tilted dish mustn't look like missing ink. What sinks slowly
along a line (a drooping edge) isn't a gap either: one begins and ends with a step.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.level_told import told_by_level
from registration.inspection.ink.presence import INK, window_noise
from registration.inspection.ink.told import Told
from registration.inspection.pictures.working import Mask, Working
from registration.inspection.values import FloatImage, Gap, Unseen
from registration.inspection.ways import Seen, Ways, stretches_of

_CORE = np.linspace(-0.3, 0.3, 7)
_OFF: Final = 0.4
"""Of a thickness, by which ink's level may lie beside its place: more, and it may be the older
layer's."""
_HIGHEST: Final = 80.0
_ROUNDS: Final = 6
_FEWEST: Final = 60
_LEAST_INK: Final = 0.35
"""Of the places, that must lie at ink's level."""
_LOW, _HIGH = -0.6, 1.6
"""Presence of what is neither ink nor older ink: shadow, a hole through it, a bubble."""
_RAISED: Final = 1.2
"""Presence of a blob on a line."""
_RIM: Final = 1.0
"""Widths from bath or a rim, within which surfaces droop and have a level of their own."""
_SHORT_AT_RIM: Final = 3.0
"""Widths, or tolerated gaps, below which a low stretch at a rim may be a droop."""
_BARE: Final = 0.25
_WHOLE: Final = 0.75
"""Presence in the middle of a hole, and within a width of it: it is a layer deep, and ink stands
on both sides. Droops of 70 sound layers of a stranger's painter went down to 0.42."""
_NEAR_END: Final = 2.0
_CRACK: Final = 0.15
_BESIDE: Final = 0.8
_STEP: Final = 0.6
_STEP_MM: Final = (0.5, 1.5)
"""Of a width, from a gap's end: there a step is behind one, and heights are averaged."""


def tell_by_height(
    work: Working,
    ways: Ways,
    seen: Seen,
    place: IntArray,
    use: BoolArray,
    ink: Mask,
    fresh: Mask,
    below: Mask,
    thickness_mm: float,
    gap_mm: float,
    rate: float,
) -> Told | None:
    """Judge places ``use`` (n,) over older ink; None where heights don't tell.

    Parameters
    ----------
    work : Working
        Of a height map.
    ways, seen
    place : (n,) int64
        `Unseen`, by place alone.
    use : (n,) bool
    ink, fresh, below : (h, w) uint8
        Where any ink is expected, the layer's own, and that of the layer directly below.
    thickness_mm : float, mm
        Of the layer.
    gap_mm : float, mm
    rate : float
        False findings per sound layer.
    """
    assert work.height is not None
    image = work.height / np.float32(thickness_mm)
    across = seen.profiles(image, ways.width[:, None] * _CORE)
    lost = seen.profiles(work.hidden.astype(np.uint8), ways.width[:, None] * _CORE, nearest=True)
    hidden = 2 * (lost > 0).sum(axis=1) >= len(_CORE)
    height = _median_of_seen(across, (lost > 0) & ~hidden[:, None])
    why = np.where((place == Unseen.SEEN) & hidden, int(Unseen.HIDDEN), place)
    why = np.where((why == Unseen.SEEN) & (ways.to_end < ways.width), int(Unseen.OLD_INK), why)
    rim, touched = _at_rim(ink, fresh, ways, seen, work)
    level = _level(height, ways.point, use & (why == Unseen.SEEN), rim)
    if level is None or np.isnan(level[use]).all():
        return None
    unknown = np.isnan(level)
    present = np.where(unknown, 0.0, height - level + 1.0)
    # Between older lines one sees deeper where ink is missing.
    spans = seen.profiles(below, ways.width[:, None] * _CORE, nearest=True).mean(axis=1) < 1.0
    present = np.where(spans, np.maximum(present, 0.0), present)
    odd = (present < _LOW) | (present > _HIGH)
    why = np.where((why == Unseen.SEEN) & odd, int(Unseen.GLARE), why)
    unknown |= _short_at_rim(present, touched, unknown, ways, gap_mm)
    why = np.where((why == Unseen.SEEN) & unknown, int(Unseen.OLD_INK), why)
    good = use & (why == Unseen.SEEN)
    sound = good & ~_near(use & (present < INK), ways, gap_mm)
    sound &= ~_near(use & (present > _RAISED), ways, gap_mm)
    noise = window_noise(present, sound, ways, None, gap_mm, known=False, even=True)
    if noise is not None:  # what lies below scatters as ink does
        noise = replace(noise, bath=float(noise.spread[0]))
    strange = np.asarray(image - np.float32(np.nanmedian(level)) > _HIGH - 1.0)
    return told_by_level(work, ways, use, image, present, why, noise, strange, gap_mm, rate)


def _near(odd: BoolArray, ways: Ways, gap_mm: float) -> BoolArray:
    """Places in long ``odd`` stretches and a width around, (n,): ink steps, it doesn't scatter.

    A sound layer has none that are longer than a tolerated gap and a width.
    """
    out = np.zeros(len(ways), dtype=np.bool_)
    for first, last in stretches_of(odd, ways.run):
        rows, width = slice(first, last + 1), float(ways.width[first])
        if float(ways.step[rows].sum()) > gap_mm + width:
            own = ways.stroke == ways.stroke[first]
            low, high = ways.along[first] - width, ways.along[last] + width
            out |= own & (ways.along >= low) & (ways.along <= high)
    return out


def _median_of_seen(across: FloatImage, lost: BoolArray) -> FloatArray:
    """Median of each row (n, k) without what is lost; no row is lost altogether."""
    ordered = np.sort(np.where(lost, np.float32(np.inf), across), axis=1)
    count, rows = (~lost).sum(axis=1), np.arange(len(across))
    middle = ordered[rows, (count - 1) // 2] + ordered[rows, count // 2]
    return np.asarray(0.5 * middle, dtype=np.float64)


def _short_at_rim(
    present: FloatArray, rim: BoolArray, unknown: BoolArray, ways: Ways, gap_mm: float
) -> BoolArray:
    """Places of short low stretches at filled areas' rims and lines' ends, (n,): both droop.

    A hole at a rim is none of them: it is a layer deep, with ink on both sides.
    """
    out = np.zeros(len(ways), dtype=np.bool_)
    ends = ways.to_end < _NEAR_END * ways.width
    for first, last in stretches_of(present < INK, ways.run):
        rows = slice(first, last + 1)
        size = max(gap_mm, float(ways.width[rows].max()))
        length = float(ways.step[rows].sum())
        droops = (rim[rows] | ends[rows]).any() and length < _SHORT_AT_RIM * size
        known = not (ends[rows] | unknown[rows]).any()
        hole = known and length >= size and _is_hole(present, unknown, ways, first, last)
        out[rows] = droops and not hole
    return out


def _is_hole(present: FloatArray, unknown: BoolArray, ways: Ways, first: int, last: int) -> bool:
    """Whether a low stretch is bare in its middle half and whole ink stands on both sides."""
    quarter = (last + 1 - first) // 4
    if float(np.median(present[first + quarter : last + 1 - quarter])) > _BARE:
        return False
    ink = (ways.run == ways.run[first]) & ~unknown & (present > _WHOLE)
    near, along = float(ways.width[first]), ways.along
    before = ink & (along < along[first]) & (along > along[first] - near)
    behind = ink & (along > along[last]) & (along < along[last] + near)
    return bool(before.any() and behind.any())


def _at_rim(
    ink: Mask, fresh: Mask, ways: Ways, seen: Seen, work: Working
) -> tuple[BoolArray, BoolArray]:
    """Places where surfaces droop, (n,): near bath or a filled area's rim; those that touch ink."""
    width_px = ways.width * work.px_per_mm
    middle, beside = np.zeros((1, 1)), ways.width[:, None] * np.array([-_BESIDE, _BESIDE])
    least = _RIM * width_px
    typical = float(np.median(width_px))
    near_bath = seen.profiles(_depth(_closed(ink, typical)), middle)[:, 0] < least
    filled = _closed(fresh, typical)
    near_rim = seen.profiles(_depth(filled), middle)[:, 0] < least
    touched = seen.profiles(filled, beside, nearest=True).any(axis=1)
    rim = near_bath | (near_rim & touched)
    return np.asarray(rim), np.asarray(rim & touched)


def _closed(ink: Mask, width_px: float) -> Mask:
    """A mask without the cracks between lines that touch."""
    side = 2 * round(_CRACK * width_px) + 3
    wide = cv2.copyMakeBorder(ink, side, side, side, side, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    return np.ascontiguousarray(closed[side:-side, side:-side])


def _depth(ink: Mask) -> FloatImage:
    return np.asarray(cv2.distanceTransform(ink, cv2.DIST_L2, 5))


def _level(
    height: FloatArray, point: FloatArray, use: BoolArray, rim: BoolArray
) -> FloatArray | None:
    """Height of sound ink at all places, thicknesses above the layer's middle, (n,).

    A surface of second order through the heights that lie nearer to it than half a thickness, and
    how much lower rims lie; NaN where it lies where older ink might, None where too few lie on it.
    """
    if use.sum() < _FEWEST:
        return None
    middle, size = point[:, :2].mean(axis=0), max(float(np.ptp(point[:, :2], axis=0).max()), 1e-6)
    x, y = (2.0 * (point[:, :2] - middle) / size).T
    basis = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    level = np.full(len(height), float(np.percentile(height[use], _HIGHEST)))
    for terms in (1,) * 2 + (3,) * (_ROUNDS // 2) + (6,) * (_ROUNDS // 2):
        near = use & (np.abs(height - level) < 0.5)
        if near.sum() < _FEWEST:
            return None
        a = basis[near, :terms]
        pull = 1e-4 * len(a) * np.eye(terms)
        pull[0, 0] = 0.0
        best = np.linalg.solve(a.T @ a + pull, a.T @ height[near])
        level = basis[:, :terms] @ best
    near = use & (np.abs(height - level) < 0.5)
    if near.sum() < _LEAST_INK * use.sum():
        return None
    for group in (rim, ~rim):
        own = near & group
        if own.sum() > max(_FEWEST, _LEAST_INK * (use & group).sum()):
            level = level + np.where(group, np.median((height - level)[own]), 0.0)
    return np.where(np.abs(level - 0.5) < _OFF, level, np.nan)


def stepped(
    gaps: list[Gap], present: FloatArray, good: BoolArray, ways: Ways
) -> tuple[list[Gap], BoolArray]:
    """Return gaps where the surface steps down, and the places of all others, (n,)."""
    kept, doubtful = [], np.zeros(len(ways), dtype=np.bool_)
    inside = [_rows(gap, ways) for gap in gaps]
    ink = good & (present > INK) & ~np.any([doubtful, *inside], axis=0)
    for gap, rows in zip(gaps, inside, strict=True):
        if _begins_with_a_step(gap, present, good & rows, ink, ways):
            kept.append(gap)
        else:
            doubtful |= rows
    return kept, doubtful


def _rows(gap: Gap, ways: Ways) -> BoolArray:
    own = ways.stroke == gap.stroke
    return np.asarray(own & (ways.along >= gap.from_mm) & (ways.along <= gap.to_mm))


def _begins_with_a_step(
    gap: Gap, present: FloatArray, bare: BoolArray, ink: BoolArray, ways: Ways
) -> bool:
    """Whether the surface steps down at a gap's begin and end, where ink goes on there.

    ``bare`` are its places (n,), ``ink`` those outside all gaps. Where no ink goes on, as of a
    stroke that is missing as a whole, the gap must lie a layer lower altogether.
    """
    if not bare.any():
        return False
    steps = []
    begin, stop = _STEP_MM
    for end, way in ((gap.from_mm, -1.0), (gap.to_mm, 1.0)):
        off = way * (ways.along - end) / ways.width
        outside = ink & (ways.stroke == gap.stroke) & (off > begin) & (off < stop)
        inside = bare & (off < -0.5 * begin) & (off > -stop)
        if outside.any():
            deep = inside if inside.any() else bare
            steps.append(float(present[outside].mean() - present[deep].mean()))
    if not steps:
        return float(np.median(present[bare])) < 1.0 - _STEP
    return min(steps) > _STEP
