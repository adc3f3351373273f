"""Judge a picture of a layer against the lines that should lie there.

1. Places along the fresh lines, closely spaced; the picture cropped and binned to them (`working`).
2. Uneven light is taken out (`light`), and the layer's shift found roughly (`coarse_shift`).
3. Ink is learned from the lines themselves, some of which may be missing (`ink_image`), over the
   bath and over older ink separately (`told`). Ink that can't be told is "not seen".
4. The shift is fitted to the offsets of the lines, and 2 and 3 are done again (`layer_shift`).
5. Gaps, widths, stretches, blobs and lumens, each against the noise of the same picture.

What a picture can't show: height (a thin line is as wide as a thick one that is flat), lines that
touch singly (their coverage is told, not their widths), ink of the bath's own colour and texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import cv2
import numpy as np

from registration.errors import PictureError
from registration.layer_images.blobs import find_blobs
from registration.layer_images.first_shift import first_shift
from registration.layer_images.gap_ends import LightAlong
from registration.layer_images.gaps import find_gaps, lit_along, merged
from registration.layer_images.in_light import LightMix
from registration.layer_images.ink_image import ACROSS, angle_of, smoothed
from registration.layer_images.layer_shift import fit_shift, nowhere_sure
from registration.layer_images.light import flattened
from registration.layer_images.lumens_seen import see_lumens
from registration.layer_images.plane_map import PlaneMap
from registration.layer_images.presence import INK, Sides
from registration.layer_images.stations import Grouping, station_profiles
from registration.layer_images.step_height import stepped, tell_by_height
from registration.layer_images.stretches import find_stretches, width_ratio
from registration.layer_images.told import ASIDE, Ground, Told, differs_enough, reasons, tell_ink
from registration.layer_images.values import (
    Appearance,
    Blob,
    BoolArray,
    ExpectedLines,
    FloatArray,
    FloatImage,
    Frame,
    Gap,
    Image,
    IntArray,
    LayerFindings,
    Lumen,
    Outlines,
    SeeingOptions,
    Shift,
    Unseen,
)
from registration.layer_images.ways import Seen, Ways, check_lines, lay_ways
from registration.layer_images.widths import StationProfiles, Widths, measure_widths
from registration.layer_images.working import Masks, Working, WorkingFrame, prepare

_STEPS_IN_GAP: Final = 4
_SAME_PX: Final = 0.4
"""A shift that changes by less isn't followed further."""
_ROUNDS: Final = 3
_EDGES_RATE: Final = 1e-4
"""Ink that is told by its edges or slopes must be missing by so much more surely."""
_SLANT: Final = 0.08
"""Lack of symmetry from which on light from the side must be reckoned with."""
_LIT_ASIDE: Final = 0.3
"""Of a width and of the slant: uncertainty of where a line lies that is lit from the side."""
_TOUCHING: Final = 0.8
"""In widths from a line's middle: ink that begins nearer touches it."""
_MOST_OLD: Final = 0.3
"""Of a line's width over older ink: more, and it is judged against that."""


def see_layer(
    picture: Image,
    frame: Frame,
    lines: ExpectedLines,
    *,
    lumens: Sequence[Lumen] = (),
    before: Image | None = None,
    hidden: Outlines = (),
    known: Appearance | None = None,
    thickness_mm: float | None = None,
    options: SeeingOptions | None = None,
) -> LayerFindings:
    """Judge a picture of a layer.

    Parameters
    ----------
    picture : (h, w) or (h, w, c) uint8, uint16 or float
        A float picture (an OCT's height map, `height_map`) is taken as it is, NaN as not seen; of
        others the logarithm.
    frame : Frame
    lines : ExpectedLines
        Of the layer, and what older lines can be seen.
    lumens : sequence of Lumen
    before : picture or None
        The same view before the layer was written: what lay there then cancels.
    hidden : sequence of (k, 2) float64, px
        Polygons of the picture behind which nothing can be seen (the needle).
    known : Appearance or None
        Of an earlier look in the same light: a layer that is missing altogether can't be learned
        from.
    thickness_mm : float or None, mm
        Of the layer, where the picture is a `height_map`: fresh ink over older ink is then told by
        its height.
    options : SeeingOptions or None

    Raises
    ------
    PictureError
        When lines or picture can't be used, or the picture shows none of the lines.
    """
    options = options or SeeingOptions()
    check_lines(lines)
    rng = np.random.default_rng(26)
    step = options.gap_mm / _STEPS_IN_GAP
    ways = lay_ways(lines, step)
    work, own = prepare(picture, frame, ways, options.gap_mm, before, hidden)
    known = known if known is None or len(known.mix) == work.channels.shape[2] else None
    if thickness_mm is not None and (work.is_log or picture.ndim != 3 or not thickness_mm > 0):
        raise PictureError(
            f"thickness_mm is {thickness_mm:g} and the picture no height map; thickness_mm > 0 mm "
            "goes with a picture of `height_map` alone"
        )
    shift = first_shift(work, own, lines, ways, options)
    for _ in range(_ROUNDS):
        look = _look(work, own, lines, ways, shift, options, known, thickness_mm, rng)
        finer = _finer(look, shift, options, work)
        if finer is None:
            break
        moved = np.hypot(finer.dx_mm - shift.dx_mm, finer.dy_mm - shift.dy_mm) * work.px_per_mm
        shift = finer
        if moved < _SAME_PX:
            break
    else:
        look = _look(work, own, lines, ways, shift, options, known, thickness_mm, rng)
    return _findings(look, lumens, _honest(shift, look), options)


@dataclass(frozen=True)
class _Look:
    """All that was learned at one shift."""

    work: Working
    frame: WorkingFrame
    ways: Ways
    moved: Ways
    seen: Seen
    flat: FloatImage
    masks: Masks
    sides: Sides
    over_old: BoolArray
    bath: Told | None
    old: Told | None
    present: FloatArray
    plain: FloatArray
    profiles: FloatImage
    why: IntArray
    group: Grouping
    stations: StationProfiles | None
    by_height: bool

    @cached_property
    def widths(self) -> Widths:
        """Widths at stations; worked out where the shift is settled."""
        if self.stations is None:
            return Widths.nothing(len(self.group.count))
        return measure_widths(self.stations)


def _look(
    work: Working,
    frame: WorkingFrame,
    lines: ExpectedLines,
    ways: Ways,
    shift: Shift,
    options: SeeingOptions,
    known: Appearance | None,
    thickness_mm: float | None,
    rng: np.random.Generator,
) -> _Look:
    by = np.array([shift.dx_mm, shift.dy_mm])
    masks, moved = Masks.of(lines, frame, work, by), ways.moved(by)
    seen = Seen.of(moved, frame)
    drawn = np.maximum(masks.fresh, masks.old)
    sides = Sides.of(seen, ways, drawn, work.px_per_mm)
    width_px = float(np.median(ways.width)) * work.px_per_mm
    flat = flattened(work.channels, masks.free, masks.core, work.px_per_mm)
    ground = Ground(
        smoothed(flat, width_px), flat, masks.free, masks.fresh, work, options.gap_mm,
        options.false_rate, known,
    )  # fmt: skip
    older = seen.profiles(masks.old, ways.width[:, None] * np.linspace(-0.5, 0.5, 9), nearest=True)
    over_old = np.asarray(older.mean(axis=1) > _MOST_OLD)
    bath = tell_ink(ground, ways, seen, sides, ~over_old, rng)
    place = reasons(work, seen, ways, np.zeros(work.shape, dtype=np.bool_))
    old = None
    if over_old.any() and thickness_mm is not None:
        old = tell_by_height(
            work, ways, seen, place, over_old, drawn, masks.fresh, thickness_mm,
            options.gap_mm, options.false_rate,
        )  # fmt: skip
    elif over_old.any():
        disc = np.ones((3, 3), np.uint8)
        alone = cv2.erode(masks.old, disc) & (cv2.dilate(masks.fresh, disc, iterations=2) == 0)
        alone = (alone & ~(work.bad | work.hidden)).astype(np.uint8)
        touching = Sides(np.full(len(ways), 0.5), np.full(len(ways), 0.5))
        on_old = replace(ground, free=alone, known=None)
        old = tell_ink(on_old, ways, seen, touching, over_old, rng)
        old = old if old is not None and differs_enough(old, bath) else None
    by_height = old is not None and thickness_mm is not None
    joined = _joined(place, over_old, bath, old)
    group = Grouping.of_ways(ways, joined[3] == Unseen.SEEN)
    stations = station_profiles(
        group, ways, seen, flat, sides, bath, over_old, joined[0], joined[3] == Unseen.SEEN, work
    )
    return _Look(
        work, frame, ways, moved, seen, flat, masks, sides, over_old, bath, old, *joined, group,
        stations, by_height,
    )  # fmt: skip


def _joined(
    place: IntArray, over_old: BoolArray, bath: Told | None, old: Told | None
) -> tuple[FloatArray, FloatArray, FloatImage, IntArray]:
    """Presence, the same without sides, profiles and reasons, of both backgrounds."""
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
    return present, plain, profiles, why


def _finer(look: _Look, shift: Shift, options: SeeingOptions, work: Working) -> Shift | None:
    if look.stations is None:
        return None
    offset = look.stations.offset_mm()
    rows = look.group.first
    rest = fit_shift(
        offset, look.ways.normal[rows], look.ways.stroke[rows], options.shift_mm, 1 / work.px_per_mm
    )
    if rest is None:
        return None
    return Shift(shift.dx_mm + rest.dx_mm, shift.dy_mm + rest.dy_mm, rest.covariance_mm2)


def _honest(shift: Shift, look: _Look) -> Shift:
    """Widen the shift of lines lit from the side: their middle isn't where it seems."""
    told = look.bath
    if told is None:
        return shift
    slant, moved = min(told.template.slant, 1.0), np.hypot(shift.dx_mm, shift.dy_mm)
    u = _LIT_ASIDE * slant * float(np.median(look.ways.width))
    u = np.hypot(u, 0.5 * float(moved) * min(slant / _SLANT, 1.0))
    return replace(shift, covariance_mm2=shift.covariance_mm2 + u**2 * np.eye(2))


def _lit_widths(look: _Look, shift: Shift) -> Widths:
    """Widen the uncertainty of widths where the shaded sides of lines may look like bath.

    Lines then seem thinner, and moved to the light by half of that. A shift and a deviation that
    could both come from it are doubted by as much as the profiles' lack of symmetry says.
    """
    rows = look.group.first
    ratio = look.widths.width_mm / look.ways.width[rows]
    if look.bath is None or not np.isfinite(ratio).any():
        return look.widths
    moved = float(np.hypot(shift.dx_mm, shift.dy_mm)) / float(np.median(look.ways.width))
    off = abs(1.0 - float(np.nanmedian(ratio)))
    doubt = min(2.0 * moved, off) * min(look.bath.template.slant / _SLANT, 1.5)
    return replace(look.widths, common=float(np.hypot(look.widths.common, doubt)))


def _findings(
    look: _Look, lumens: Sequence[Lumen], shift: Shift, options: SeeingOptions
) -> LayerFindings:
    ways, why = look.ways, look.why.copy()
    if not look.by_height and nowhere_sure(shift, float(np.median(ways.width))):
        beside = np.minimum(look.sides.left, look.sides.right) < _TOUCHING
        why[beside & (why == Unseen.SEEN)] = int(Unseen.UNCLEAR)
    good = why == Unseen.SEEN
    places = max(1, round(float(ways.step[good].sum()) / options.gap_mm))
    blobs, big = _blobs(look, options)
    if big.any():
        under = look.seen.profiles(big.astype(np.uint8), ways.width[:, None] * ACROSS, True)
        why[good & under.any(axis=1)] = int(Unseen.HIDDEN)
        good = why == Unseen.SEEN
    gaps = _gaps(look, good, why, places, options)
    widths = _lit_widths(look, shift)
    stations = look.group.stations(ways, look.present, why, widths)
    stretches = find_stretches(stations, widths, options.width_percent)
    told = look.bath
    usable = told is not None and told.noise is not None and told.template.filled
    lost = look.work.bad | look.work.hidden if told is None else told.strange | look.work.hidden
    seen_lumens = see_lumens(
        lumens,
        told.image if told is not None and usable else None,
        lost,
        look.masks.old,
        look.frame,
        np.array([shift.dx_mm, shift.dy_mm]),
        1.0 / look.work.px_per_mm,
        told.bath_spread if told is not None else 1.0,
    )
    ratio, u_ratio = width_ratio(stations, widths)
    way = ways.step
    seen_mm = float(way[good].sum())
    covered = float((np.clip(look.present[good], 0.0, 1.0) * way[good]).sum())
    return LayerFindings(
        stations=stations,
        gaps=merged(gaps, ways),
        stretches=stretches,
        blobs=blobs,
        lumens=seen_lumens,
        width_ratio=ratio,
        u_width_ratio=u_ratio,
        seen_share=seen_mm / float(way.sum()),
        coverage=covered / seen_mm if seen_mm > 0 else np.nan,
        shift=shift,
        places=places,
        contrast=told.contrast if told is not None else 0.0,
        appearance=told.appearance if told is not None and told.noise is not None else None,
    )


def _gaps(
    look: _Look, good: BoolArray, why: IntArray, places: int, options: SeeingOptions
) -> list[Gap]:
    """Gaps over either background; marks in ``why`` what turns out unclear."""
    found: list[Gap] = []
    needed = options.false_rate / places
    beside = look.ways.width[:, None] * np.linspace(-1.5, 1.5, 13)
    for told, rows in ((look.bath, ~look.over_old), (look.old, look.over_old)):
        if told is not None and told.noise is not None:
            around = look.seen.profiles(told.strange.astype(np.float32), beside).mean(axis=1)
            clear = rows & (good if not told.faint else told.why == Unseen.SEEN)
            # Slopes and edges scatter with the light, not with noise alone.
            certain = needed * (_EDGES_RATE if told.template.by_edges else 1.0)
            gaps, unclear = find_gaps(
                look.present, clear, look.ways, told.noise, options.gap_mm, certain, around
            )
            if told.template.slant > ASIDE:
                angle = angle_of(look.seen)
                gaps = [
                    gap
                    for gap in gaps
                    if not lit_along(gap, look.ways, angle, look.present, clear, why)
                ]
            if look.by_height and told is look.old:
                gaps, doubtful = stepped(gaps, look.present, clear, look.ways)
                unclear |= doubtful
            if told is look.bath and look.work.is_log and told.template.filled:
                alone = np.minimum(look.sides.left, look.sides.right) > _TOUCHING
                ends = LightAlong(
                    look.flat, LightMix.of(told.appearance.mix, told.ink, True), look.ways,
                    look.seen, look.widths.optics, 1.0 / look.work.px_per_mm,
                )  # fmt: skip
                gaps = ends.measured(gaps, clear & (look.present > INK), alone)
            found += gaps
            why[unclear] = int(Unseen.UNCLEAR)
            noise = told.noise
            # Bath that looks like ink beside a line that doesn't: light changes there.
            doubt = good & rows & (look.plain < INK * noise.middle) & (look.present > INK)
            why[doubt & (look.plain < 0.25 * noise.middle)] = int(Unseen.UNCLEAR)
    return found


def _blobs(look: _Look, options: SeeingOptions) -> tuple[tuple[Blob, ...], BoolArray]:
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
