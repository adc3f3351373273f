"""Derive gaps, blobs, widths and lumens of a layer from the ink presence at a known shift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.findings import LayerFindings
from registration.inspection.gaps.along_strokes import reached
from registration.inspection.gaps.between_older import BARE
from registration.inspection.gaps.gap_ends import LightAlong
from registration.inspection.gaps.gaps import find_gaps, inside, lit_along, merged, shift_along
from registration.inspection.gaps.height_ends import HeightsAlong, Section
from registration.inspection.gaps.sure_ink import unsure_places
from registration.inspection.ink.directions import ASIDE
from registration.inspection.ink.in_light import LightMix
from registration.inspection.ink.ink_image import ACROSS, SMOOTH, angle_of
from registration.inspection.ink.presence import INK
from registration.inspection.ink.told import Told
from registration.inspection.lit_from_the_side import lit_widths
from registration.inspection.on_lines import blobs_on_lines
from registration.inspection.options import SeeingOptions
from registration.inspection.over_ink.changed import unchanged
from registration.inspection.over_ink.step_height import stepped
from registration.inspection.pictures.plane_map import PlaneMap
from registration.inspection.pictures.working import Mask
from registration.inspection.seen_layer import SeenLayer
from registration.inspection.unseen.bare_strokes import bare_strokes
from registration.inspection.unseen.debris import is_bare
from registration.inspection.unseen.seam_findings import seam_findings, without_thin
from registration.inspection.unseen.told_by_all import thin_without_width, told_by_all
from registration.inspection.unseen.unseen_ways import doubted_gaps, unseen_ways
from registration.inspection.values import Blob, Gap, Lumen, LumenSeen, Shift, Unseen
from registration.inspection.ways import Ways
from registration.inspection.widths.blobs import find_blobs
from registration.inspection.widths.lumens_seen import see_lumens
from registration.inspection.widths.stretches import find_stretches, width_ratio

_EDGES_RATE: Final = 1e-4
"""Ink that is told by its edges or slopes must be missing by so much more surely."""
_HALF_SHOWN: Final = 0.5
"""Of a width, by which a line may lie aside and still show as half of its presence."""
_HOLE_PX: Final = 3.0
"""Working pixels: holes that are as wide are filled with what lies around."""
_FEWEST_HEIGHTS: Final = 20
_TOUCHING: Final = 0.8
"""In widths from a line's middle: ink that begins nearer touches it."""


def _nowhere_sure(shift: Shift, ways: Ways) -> bool:
    """Whether the layer's place is known in no direction to 0.4 of a line's width.

    Lines that touch would then be held against their neighbours, or the bath beside the part.
    """
    least = float(np.linalg.eigvalsh(shift.covariance_mm2)[0])
    return least > (0.4 * float(np.median(ways.width))) ** 2


def _bare_anyway(look: SeenLayer, reach_mm: float) -> BoolArray:
    """Places that would show some of a line wherever it lay within reach, and show none, (n,)."""
    none = look.inferred.copy()
    if look.bath is not None and look.bath.noise is not None:
        none |= ~look.over_old & (look.present < BARE * look.bath.noise.middle)
    return none & (reach_mm < _HALF_SHOWN * look.ways.width)


def findings_of(
    look: SeenLayer, lumens: Sequence[Lumen], shift: Shift, options: SeeingOptions
) -> LayerFindings:
    """Return all that a layer seen at a shift tells, each finding against the picture's noise."""
    ways, why = look.ways, look.why.copy()
    if not look.by_height and _nowhere_sure(shift, ways):
        beside = np.minimum(look.sides.left, look.sides.right) < _TOUCHING
        beside &= ~(look.over_old & look.by_change) & ~_bare_anyway(look, options.shift_mm)
        why[beside & (why == Unseen.SEEN)] = int(Unseen.UNCLEAR)
    good = why == Unseen.SEEN
    faint = _faint(look)
    tested = good | faint
    places = max(1, round(float(ways.step[tested].sum()) / options.gap_mm))
    blobs, big = _blobs(look, options)
    if big.any():
        under = look.seen.profiles(big.astype(np.uint8), ways.width[:, None] * ACROSS, True)
        why[good & under.any(axis=1)] = int(Unseen.HIDDEN)
        good = why == Unseen.SEEN
    gaps, told_there = _gaps(look, good, why, places, options)
    gaps = without_thin(look, gaps)
    doubted = doubted_gaps(look, gaps, places, options)
    gaps, lost = _beside(look, gaps, told_there, why)
    why[lost] = int(Unseen.SEEN)
    look = replace(look, present=np.where(lost, 0.0, look.present))
    good = why == Unseen.SEEN  # without what turned out unclear
    widths = lit_widths(look, shift)
    seams = seam_findings(look, gaps, why)
    stations = look.group.stations(ways, look.present, why, widths)
    stations = replace(stations, seam_share=seams.share)
    stretches = find_stretches(stations, widths, options.width_percent) + seams.stretches
    told = look.bath
    ratio, u_ratio = width_ratio(stations, widths)
    way = ways.step
    seen_mm = float(way[good].sum())
    covered = float((seams.ink[good] * way[good]).sum())
    step, limit = (math.nan, math.nan) if look.change is None else look.change.over_older()
    return LayerFindings(
        stations=stations,
        gaps=_placed(merged(gaps, ways), look, shift, good),
        stretches=stretches,
        blobs=blobs + blobs_on_lines(look),
        lumens=_lumens(look, lumens, shift),
        width_ratio=ratio,
        u_width_ratio=u_ratio,
        seen_share=seen_mm / float(way.sum()),
        coverage=covered / seen_mm if seen_mm > 0 else np.nan,
        shift=shift,
        places=places,
        contrast=told.contrast if told is not None else 0.0,
        appearance=told.appearance if told is not None and told.noise is not None else None,
        moved_px=look.work.moved_px,
        bare=bare_strokes(look, why, np.random.default_rng(29)),
        unseen=unseen_ways(
            look, why, gaps, doubted, options.gap_mm, options.unseen_mm, options.false_rate
        ),
        faint_share=float(way[faint & ~good].sum()) / float(way.sum()),
        least_gap_mm=_least_gap_mm(look),
        by_height_share=float(way[_by_height(look, good)].sum()) / float(way.sum()),
        waver=_waver(look, good),
        older_mm=float(way[look.over_old].sum()),
        older_step=step,
        older_limit=limit,
        told=told_by_all(look, good, faint, thin_without_width(look)),
        untold_seams=seams.untold,
    )


def _faint(look: SeenLayer) -> BoolArray:
    """Places at which ink shows too faintly for short gaps to be told, (n,)."""
    faint = np.zeros(len(look.ways), dtype=np.bool_)
    for told in (look.bath, look.old):
        if told is not None and told.noise is not None and told.faint:
            rows = look.over_old if told is look.old else ~look.over_old
            faint |= rows & (told.why == Unseen.SEEN)
    return faint


def _lumens(look: SeenLayer, lumens: Sequence[Lumen], shift: Shift) -> tuple[LumenSeen, ...]:
    """Lumens as the picture shows them, not seen where ink and bath can't be told apart."""
    told = look.bath
    usable = told is not None and told.noise is not None and told.template.filled
    return see_lumens(
        lumens,
        told.image if told is not None and usable else None,
        (look.work.bad if told is None else told.strange) | look.work.hidden,
        look.masks.old,
        look.frame,
        np.array([shift.dx_mm, shift.dy_mm]),
        1.0 / look.work.px_per_mm,
        told.bath_spread if told is not None else 1.0,
    )


def _least_gap_mm(look: SeenLayer) -> float:
    """Shortest gap that surely shows in a profiler's map, mm.

    Its ground beyond the shadow of the layer's height (45 degrees) is wider than what is filled in
    as a small hole.
    """
    if not look.work.flanks_lost or look.thickness_mm is None:
        return 0.0
    return look.thickness_mm + _HOLE_PX / look.work.px_per_mm


def _by_height(look: SeenLayer, good: BoolArray) -> BoolArray:
    """Places over older ink that are told by height, (n,)."""
    return np.asarray(good & look.over_old & look.by_height & ~look.inferred)


def _waver(look: SeenLayer, good: BoolArray) -> float:
    """Standard deviation of the heights of ink over older ink, by stations; NaN for too few."""
    use = _by_height(look, good)
    height = look.group.mean(np.nan_to_num(look.present), use)
    ink = height[np.isfinite(height) & (height > INK)]
    if len(ink) < _FEWEST_HEIGHTS:
        return math.nan
    low, high = np.percentile(ink, [15.87, 84.13])
    return 0.5 * float(high - low)


def _gaps(
    look: SeenLayer, good: BoolArray, why: IntArray, places: int, options: SeeingOptions
) -> tuple[list[Gap], BoolArray]:
    """Gaps over either background, and where presence tells of ink; marks in ``why`` the unclear.

    What is unclear by its steps and changes alone still tells as much as its level does.
    """
    found: list[Gap] = []
    vague = np.zeros(len(look.ways), dtype=np.bool_)
    needed = options.false_rate / places
    beside = look.ways.width[:, None] * np.linspace(-1.5, 1.5, 13)
    near = _near_old(look)
    for told, rows in ((look.bath, ~look.over_old | look.inferred), (look.old, look.over_old)):
        if told is not None and told.noise is not None:
            around = _strange_around(look, told, near, beside)
            clear = rows & (good if not told.faint else told.why == Unseen.SEEN)
            # Slopes and edges scatter with the light, not with noise alone.
            certain = needed * (_EDGES_RATE if told.template.by_edges and not told.shaded else 1.0)
            gaps, unclear = find_gaps(
                look.present, clear, look.inferred, look.ways, told.noise, options.gap_mm, certain,
                around, told.faint and told is look.bath, told.strength,
            )  # fmt: skip
            if told.template.slant > ASIDE and not told.shaded:
                angle = angle_of(look.seen)
                gaps = [
                    gap
                    for gap in gaps
                    if not lit_along(gap, look.ways, angle, look.present, clear, why)
                ]
            if look.by_height and told is look.old:
                gaps, doubtful = stepped(gaps, look.present, clear, look.ways)
                unclear |= doubtful
                vague |= doubtful
            elif look.by_change and told is look.old:
                gaps, doubtful = unchanged(
                    gaps, look.present, clear, look.ways, partial(_changed_share, look)
                )
                gaps, more = stepped(gaps, look.present, clear, look.ways)
                unclear |= doubtful | more
                vague |= doubtful | more
            else:
                shown = ~look.inferred
                gaps = [
                    gap
                    for gap in gaps
                    if is_bare(gap, look.ways, look.seen, shown, told, near, why)
                ]
            if told is look.bath and look.work.is_log and told.template.filled and not told.faint:
                gaps = _with_ends(gaps, look, told, clear)
            found += gaps
            why[unclear] = int(Unseen.UNCLEAR)
            noise = told.noise
            if told.shaded:
                unsure = unsure_places(
                    look.present, clear & (why == Unseen.SEEN), look.ways, noise, options.gap_mm,
                    certain, told.strength,
                )  # fmt: skip
                why[unsure & ~inside(gaps, look.ways)] = int(Unseen.UNCLEAR)
            # Bath that looks like ink beside a line that doesn't: light changes there.
            doubt = good & rows & (look.plain < INK * noise.middle) & (look.present > INK)
            why[doubt & (look.plain < 0.25 * noise.middle)] = int(Unseen.UNCLEAR)
    return found, good & (vague | (why == Unseen.SEEN))


def _changed_share(look: SeenLayer, rows: BoolArray) -> float:
    """How much the picture changed at places, over what it does by ink on such lines."""
    assert look.change is not None
    return look.change.share(rows, look.ways.normal)


def _beside(
    look: SeenLayer, gaps: list[Gap], told_there: BoolArray, why: IntArray
) -> tuple[list[Gap], BoolArray]:
    """Gaps with what is missing beside them, and the places of that."""
    level, spread = np.full(len(look.ways), np.nan), np.zeros(len(look.ways))
    for told, rows in ((look.bath, ~look.over_old | look.inferred), (look.old, look.over_old)):
        if told is not None and told.noise is not None:
            use = rows & told_there
            level[use] = look.present[use] / told.noise.middle
            spread[use] = float(told.noise.spread[0]) / told.noise.middle
    return reached(gaps, level, why == Unseen.SEEN, spread, look.ways)


def _strange_around(look: SeenLayer, told: Told, near: Mask, across_mm: FloatArray) -> FloatArray:
    """Share of each place's surroundings, away from older ink, that is strange, (n,).

    Older ink is neither fresh ink nor bath in the difference to a picture before.
    """
    clear = look.seen.profiles(near, across_mm, nearest=True) == 0
    strange = look.seen.profiles(told.strange.astype(np.float32), across_mm)
    return np.asarray((strange * clear).sum(axis=1) / np.maximum(clear.sum(axis=1), 1))


def _near_old(look: SeenLayer) -> Mask:
    """Older ink, and as far around it as its edge is smoothed, (h, w)."""
    width_px = float(np.median(look.ways.width)) * look.work.px_per_mm
    side = 2 * round(2.0 * SMOOTH * width_px) + 3
    return np.asarray(cv2.dilate(look.masks.old, np.ones((side, side), np.uint8)))


def _with_ends(gaps: list[Gap], look: SeenLayer, told: Told, clear: BoolArray) -> list[Gap]:
    """Return gaps with their ends measured in light."""
    alone = np.minimum(look.sides.left, look.sides.right) > _TOUCHING
    mix = LightMix.of(told.appearance.mix, told.ink)
    known = look.widths.width_mm[np.isfinite(look.widths.width_mm)]
    width = float(np.median(known if len(known) else look.ways.width))
    px_mm = 1.0 / look.work.px_per_mm
    ends = LightAlong(look.flat, mix, look.ways, look.seen, width, look.widths.shade, px_mm)
    return ends.measured(gaps, clear & (look.present > INK), alone)


def _placed(
    gaps: tuple[Gap, ...], look: SeenLayer, shift: Shift, good: BoolArray
) -> tuple[Gap, ...]:
    """Gaps with what the layer's shift adds to their ends' uncertainty; a profiler's end at tips.

    ``good`` are places that are seen, (n,).
    """
    if look.work.flanks_lost and look.work.height is not None and look.thickness_mm:
        told = look.widths.width_mm / look.ways.width[look.group.first]
        ends = HeightsAlong(
            look.work.height / np.float32(look.thickness_mm), look.work.hidden, look.ways,
            look.seen, Section.of_widths(told), look.thickness_mm, 1.0 / look.work.px_per_mm,
        )  # fmt: skip
        alone = np.minimum(look.sides.left, look.sides.right) > _TOUCHING
        gaps = tuple(ends.measured(gaps, good & (look.present > INK), alone))
    return tuple(replace(gap, u_shift_mm=shift_along(gap, look.ways, shift)) for gap in gaps)


def _blobs(look: SeenLayer, options: SeeingOptions) -> tuple[tuple[Blob, ...], BoolArray]:
    told = look.bath
    nothing = np.zeros(look.work.shape, dtype=np.bool_)
    if told is None or told.noise is None or not told.template.filled:
        return (), nothing
    px_mm = 1.0 / look.work.px_per_mm
    return find_blobs(
        told.image,
        look.masks.free,
        told.strange | look.work.hidden,
        np.maximum(look.masks.fresh, look.masks.old),
        float(np.median(look.ways.width)) / px_mm,
        PlaneMap.of(look.frame, look.moved, px_mm),
        options.false_rate,
    )
