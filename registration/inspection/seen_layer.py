"""Evaluate a layer picture at one shift: ink presence over bath and older ink, and widths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.gaps.between_older import infer_missing, is_contradicted
from registration.inspection.heights.height import HeightFrame
from registration.inspection.ink.ink_image import ACROSS, smoothed
from registration.inspection.ink.place_reasons import reasons
from registration.inspection.ink.presence import Sides
from registration.inspection.ink.told import (
    Ground,
    Told,
    tell_ink,
)
from registration.inspection.options import SeeingOptions
from registration.inspection.over_ink.changed import Places, tell_by_change
from registration.inspection.over_ink.covered import Covers
from registration.inspection.over_ink.picture_change import (
    Change,
    Unwritten,
    change_along,
    lay_older,
)
from registration.inspection.over_ink.step_height import tell_by_height
from registration.inspection.pictures.light import flattened
from registration.inspection.pictures.working import (
    Mask,
    Masks,
    Working,
    WorkingFrame,
    drawn_lines,
)
from registration.inspection.ridges.ridge_shading import RidgeLight
from registration.inspection.ridges.told_by_ridges import tell_ridges
from registration.inspection.values import Appearance, ExpectedLines, FloatImage, Shift, Unseen
from registration.inspection.ways import Seen, Ways
from registration.inspection.widths.stations import Grouping, station_widths
from registration.inspection.widths.widths import Widths
from registration.inspection.widths.widths_by_change import widths_by_change

_MOST_OLD: Final = 0.3
"""Of a line's width over older ink: more, and it is judged against that."""
_OWN_LOOK: Final = 0.3
"""Of the difference of ink and bath that fresh ink must show over older ink."""
_MORE_SEEN: Final = 1.5
_ONE_BELOW: Final = 1.5
"""Thicknesses from middle to middle, within which an older line lies directly below."""
_SAME_HEIGHT: Final = 0.25
"""Of a width: older ink of heights that differ by less is of one layer."""
_NEARBY: Final = 0.1
"""Of a width, by which older ink may be wider, or lie aside."""
_UNSETTLED: Final = 0.1
"""Of a width over ink that was written since the picture before: what changed tells nothing."""


@dataclass(frozen=True)
class SeenLayer:
    """All that was learned of a layer at one shift.

    Attributes
    ----------
    over_old, inferred : (n,) bool
        Places over older ink, and those of them from which ink is missing by the bath beside them.
    bath, old : Told or None
        Ink over either.
    present, plain : (n,) float64
        As of `Told`, of both together.
    why : (n,) int64
        `Unseen`.
    change : Change or None
        Of the picture since the one before; None without one.
    """

    work: Working
    frame: WorkingFrame
    ways: Ways
    moved: Ways
    seen: Seen
    flat: FloatImage
    masks: Masks
    sides: Sides
    over_old: BoolArray
    inferred: BoolArray
    bath: Told | None
    old: Told | None
    present: FloatArray
    plain: FloatArray
    profiles: FloatImage
    why: IntArray
    group: Grouping
    widths: Widths
    by_height: bool
    by_change: bool
    change: Change | None
    thickness_mm: float | None = None


def seen_at_shift(
    work: Working,
    frame: WorkingFrame,
    lines: ExpectedLines,
    late: BoolArray,
    ways: Ways,
    shift: Shift,
    options: SeeingOptions,
    known: Appearance | None,
    thickness_mm: float | None,
    rng: np.random.Generator,
    light: RidgeLight | None = None,
) -> SeenLayer:
    """Learn ink over the bath and over older ink, presence and widths at one shift.

    With a ``light`` on ridges ink over the bath is told by their shading.
    """
    by = np.array([shift.dx_mm, shift.dy_mm])
    masks, moved = Masks.of(lines, frame, work, by), ways.moved(by)
    seen = Seen.of(moved, frame, options.round_lines)
    drawn = np.maximum(masks.fresh, masks.old)
    sides = Sides.of(seen, ways, drawn, work.px_per_mm)
    width_px = float(np.median(ways.width)) * work.px_per_mm
    flat = flattened(work.channels, masks.free, masks.core, work.px_per_mm)
    ground = Ground(
        smoothed(flat, width_px), flat, masks.free, masks.fresh, work, options.gap_mm,
        options.false_rate, known, options.width_percent / 100.0,
    )  # fmt: skip
    older = seen.profiles(masks.old, ways.width[:, None] * np.linspace(-0.5, 0.5, 9), nearest=True)
    over_old = np.asarray(older.mean(axis=1) > _MOST_OLD)
    covers = Covers.of(moved, seen, _scanner(work, frame))
    alone = ~over_old & ~covers.places
    bath, for_widths = _over_bath(ground, ways, seen, sides, alone, light, rng)
    # A gap in a solid layer lies in the shadow of the lines beside it, as a profiler sees it: what
    # shows of its ground tells it.
    nothing = np.zeros(work.shape, dtype=np.bool_)
    place = reasons(work, seen, ways, nothing, by_hidden=thickness_mm is None)
    old, change = None, None
    if work.earlier is not None and thickness_mm is None:
        bare = _unwritten(work, frame, lines, late, by, masks, ways, seen, over_old)
        lower = lay_older(lines, late, ways)
        lower = None if lower is None else lower.moved(by)
        change = change_along(work, frame, ways, seen, lower, bare)
    if over_old.any() and thickness_mm is not None:
        below = _directly_below(work, frame, lines, by, thickness_mm)
        old = tell_by_height(
            work, ways, seen, place, over_old, drawn, masks.fresh, below, thickness_mm,
            options.gap_mm, options.false_rate,
        )  # fmt: skip
    elif over_old.any() and work.earlier is not None:
        places = _places(work, bare, masks, ways, seen)
        old = tell_by_change(work, places, options.gap_mm, options.false_rate, rng)
    elif over_old.any():
        old = _by_contrast(ground, masks, ways, seen, over_old, bath, rng)
    if _is_contradicted(bath, old, over_old, ways):
        old = None
    covered = covers.untold(bath, over_old, ways, options.gap_mm)
    place[covered & (place == Unseen.SEEN)] = int(Unseen.COVERED)
    bath, old = (_without(covered, told) for told in (bath, old))
    by_height = old is not None and thickness_mm is not None
    by_change = old is not None and thickness_mm is None and work.earlier is not None
    joined, inferred = _joined(place, over_old, bath, old, ways)
    group = Grouping.of_ways(ways, joined[3] == Unseen.SEEN)
    profiles = joined[2] if for_widths is None else for_widths.profiles
    widths = station_widths(
        group, ways, profiles, sides, for_widths, over_old, joined[0], joined[3] == Unseen.SEEN,
        work,
    )  # fmt: skip
    told = bath is not None and bath.noise is not None and work.earlier is not None
    if told and not np.isfinite(widths.width_mm).any():
        shown = joined[3] == Unseen.SEEN
        widths = widths_by_change(
            ground, ways, seen, masks.fresh, over_old, joined[0], shown, group, rng
        )
    return SeenLayer(
        work, frame, ways, moved, seen, flat, masks, sides, over_old, inferred, bath, old, *joined,
        group, widths, by_height, by_change, change, thickness_mm,
    )  # fmt: skip


def _scanner(work: Working, frame: WorkingFrame) -> int:
    """Side from which a volume is scanned, as of `Covers.of`; 0 for other pictures."""
    if not work.is_scatter or not isinstance(frame.frame, HeightFrame):
        return 0
    return 1 if frame.frame.from_above else -1


def _over_bath(
    ground: Ground,
    ways: Ways,
    seen: Seen,
    sides: Sides,
    alone: BoolArray,
    light: RidgeLight | None,
    rng: np.random.Generator,
) -> tuple[Told | None, Told | None]:
    """Ink over the bath, and what its widths are told by."""
    bath = for_widths = tell_ink(ground, ways, seen, sides, alone, rng)
    if ground.work.earlier is not None:
        # A difference helps in a grainy bath, and tells less of ink that a bubble's light falls on.
        count = ground.work.earlier.shape[2]
        both = (ground.smooth, ground.flat)
        smooth, flat = (np.ascontiguousarray(each[:, :, :count]) for each in both)
        itself = replace(ground, smooth=smooth, flat=flat)
        by_itself = tell_ink(itself, ways, seen, sides, alone, rng)
        # What tells ink best by the change is brightness, whose edges rims and ridges move; colour
        # alone counts little there.
        for_widths = bath if by_itself is None or by_itself.noise is None else by_itself
        bath = _better(bath, by_itself)
    if light is not None and bath is not None:
        bath = for_widths = tell_ridges(light, ground, ways, seen, alone, bath, rng)
    return bath, for_widths


def _by_contrast(
    ground: Ground,
    masks: Masks,
    ways: Ways,
    seen: Seen,
    over_old: BoolArray,
    bath: Told | None,
    rng: np.random.Generator,
) -> Told | None:
    """Ink over older ink by the older ink alone; None where it looks like that over the bath."""
    disc, work = np.ones((3, 3), np.uint8), ground.work
    bare = cv2.erode(masks.old, disc) & (cv2.dilate(masks.fresh, disc, iterations=2) == 0)
    bare = (bare & ~(work.bad | work.hidden)).astype(np.uint8)
    touching = Sides(np.full(len(ways), 0.5), np.full(len(ways), 0.5))
    old = tell_ink(replace(ground, free=bare, known=None), ways, seen, touching, over_old, rng)
    return old if old is not None and _differs_enough(old, bath) else None


def _differs_enough(told: Told, bath: Told | None) -> bool:
    """Whether fresh ink differs from older ink by more than edges and focus do.

    Older ink of the same kind looks as a line would that isn't there.
    """
    if bath is None:
        return True
    usual = abs(float(told.appearance.mix @ bath.ink))
    return abs(told.template.scale) > _OWN_LOOK * usual


def _better(one: Told | None, other: Told | None) -> Told | None:
    """Return the first of two, or the second where that tells ink at clearly more places."""
    if one is None or other is None:
        return one or other
    if one.noise is None or other.noise is None:
        return one if one.noise is not None else other
    seen, other_seen = (int((each.why == Unseen.SEEN).sum()) for each in (one, other))
    return other if other_seen > _MORE_SEEN * seen else one


def _without(covered: BoolArray, told: Told | None) -> Told | None:
    """Ink that isn't told where another fresh line covers the place."""
    if told is None:
        return None
    own = covered & ~np.isin(told.why, (Unseen.OUTSIDE, Unseen.HIDDEN))
    return replace(told, why=np.where(own, int(Unseen.COVERED), told.why))


def _directly_below(
    work: Working, frame: WorkingFrame, lines: ExpectedLines, by_mm: FloatArray, thickness_mm: float
) -> Mask:
    """Draw older lines of the layer directly below, (h, w)."""
    least = float(np.median(lines.end[lines.fresh, 2])) - _ONE_BELOW * thickness_mm
    row = ~lines.fresh & (lines.end[:, 2] > least)
    by = np.append(by_mm, 0.0)
    ends = [frame.to_pixels(one[row] + by) for one in (lines.start, lines.end)]
    return drawn_lines(work.shape, np.stack(ends, axis=1), lines.width_mm[row] * work.px_per_mm)


def _onto(
    work: Working,
    frame: WorkingFrame,
    lines: ExpectedLines,
    by_mm: FloatArray,
    ways: Ways,
    seen: Seen,
) -> IntArray:
    """Rank, from below, of the height of the topmost older ink at each place, (n,); 0 for none."""
    old, by = ~lines.fresh, np.append(by_mm, 0.0)
    width = float(np.median(ways.width))
    height, order = np.unique(lines.end[old, 2], return_inverse=True)
    rank = np.cumsum(np.diff(height, prepend=-np.inf) > _SAME_HEIGHT * width)[order]
    ends = np.stack([frame.to_pixels(one[old] + by) for one in (lines.start, lines.end)], axis=1)
    px = (lines.width_mm[old] + _NEARBY * width) * work.px_per_mm
    across = ways.width[:, None] * np.linspace(-0.3, 0.3, 5)
    out = np.zeros(len(ways), dtype=np.int64)
    for one in range(1, int(rank.max(initial=0)) + 1):
        drawn = drawn_lines(work.shape, ends[rank == one], px[rank == one])
        out[seen.profiles(drawn, across, nearest=True).any(axis=1)] = one
    return out


def _unwritten(
    work: Working,
    frame: WorkingFrame,
    lines: ExpectedLines,
    late: BoolArray,
    by_mm: FloatArray,
    masks: Masks,
    ways: Ways,
    seen: Seen,
    over_old: BoolArray,
) -> Unwritten:
    """What was written since the picture before, and what not."""
    written = masks.fresh.copy()
    settled = np.ones(len(ways), dtype=np.bool_)
    if late.any():
        ends = np.stack([frame.to_pixels(lines.start[late]), frame.to_pixels(lines.end[late])], 1)
        mended = drawn_lines(work.shape, ends, lines.width_mm[late] * work.px_per_mm)
        across = ways.width[:, None] * np.linspace(-0.5, 0.5, 9)
        settled = seen.profiles(mended, across, nearest=True).mean(axis=1) < _UNSETTLED
        written |= mended
    side = 2 * round(0.4 * float(np.median(ways.width)) * work.px_per_mm) + 5
    lost = (work.bad | work.hidden).astype(np.uint8)
    ground = 1 - (cv2.dilate(written, np.ones((side, side), np.uint8)) | lost)
    onto = _onto(work, frame, lines, by_mm, ways, seen)
    return Unwritten(settled, ground, masks.old, over_old, onto)


def _places(work: Working, bare: Unwritten, masks: Masks, ways: Ways, seen: Seen) -> Places:
    """Places over older ink, to be told by the picture before."""
    assert work.earlier is not None
    earlier = flattened(work.earlier, masks.free, masks.core, work.px_per_mm)
    both = masks.old & masks.fresh
    return Places(ways, seen, bare.over_old, bare.settled, bare.onto, bare.ground, both, earlier)


def _is_contradicted(bath: Told | None, old: Told | None, over_old: BoolArray, ways: Ways) -> bool:
    """Whether ink that is told on older ink is belied by the bath beside it."""
    if bath is None or bath.noise is None or old is None:
        return False
    on_bath = ~over_old & (bath.why == Unseen.SEEN)
    on_old = over_old & (old.why == Unseen.SEEN)
    return is_contradicted(old.present, on_old, bath.present, on_bath, ways, bath.noise.middle)


def _joined(
    place: IntArray, over_old: BoolArray, bath: Told | None, old: Told | None, ways: Ways
) -> tuple[tuple[FloatArray, FloatArray, FloatImage, IntArray], BoolArray]:
    """Presence, the same without sides, profiles and reasons, of both; and what is inferred."""
    count = len(place)
    present, plain = np.full(count, np.nan), np.full(count, np.nan)
    profiles = np.zeros((count, len(ACROSS)), dtype=np.float32)
    why = np.full(count, int(Unseen.FAINT))
    for told, rows, faint in ((bath, ~over_old, Unseen.FAINT), (old, over_old, Unseen.OLD_INK)):
        why[rows] = np.where(place[rows] == Unseen.SEEN, int(faint), place[rows])
        if told is None:
            continue
        present[rows], plain[rows] = told.present[rows], told.plain[rows]
        profiles[rows] = told.profiles[rows]
        why[rows] = np.where(
            (told.why[rows] == Unseen.SEEN) & told.faint, int(faint), told.why[rows]
        )
    inferred = np.zeros(count, dtype=np.bool_)
    if bath is not None and bath.noise is not None and old is None:
        on_bath = ~over_old & (why == Unseen.SEEN)
        inferred = infer_missing(present, on_bath, why, ways, bath.noise.middle)
        present[inferred] = plain[inferred] = 0.0
        why[inferred] = int(Unseen.SEEN)
    return (present, plain, profiles, why), inferred
