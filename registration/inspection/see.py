"""Judge a picture, a height map or a scan's picture of a layer: the door of this room.

1. The picture is cropped and binned, and the one before laid over it (`pictures`).
2. Light, the layer's shift, ink's profile across a line, and how much ink lies at each place follow
   from each other in some rounds (`ink.learn`): a view is ground plus profiles along lines.
3. Each place is full, thin, bare or hidden, with a probability (`ink.chain`).
4. Gaps, widths, stretches, blobs and lumens are read from that (`found`).

What a picture can't show: height (a thin line is as wide as a thick one that is flat), ink of the
bath's own colour and texture, ink over older ink that it doesn't change. There probabilities stay
where they were without a picture, and the place counts as not seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import logit

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.findings import LayerFindings
from registration.inspection.found.gaps import gaps_of
from registration.inspection.found.ink_level import InkLevel
from registration.inspection.found.line_width import UsualWidth, Widths, station_widths, usual_ratio
from registration.inspection.found.stations import Grouping
from registration.inspection.found.stretches import all_stretches, width_ratio
from registration.inspection.ink.chain import BARE, FULL, HIDDEN, PRIOR_BARE, expected_ink
from registration.inspection.ink.ink_model import NODES, InkModel
from registration.inspection.ink.learn import Learned, learned
from registration.inspection.ink.passes import REACH
from registration.inspection.ink.shares import ACROSS, StripNoise, measured
from registration.inspection.inputs import (
    BOOLS,
    check_array,
    check_before,
    check_frame,
    check_hidden,
    check_known,
    check_lines,
    check_lumens,
    check_picture,
    check_thickness,
    check_type,
)
from registration.inspection.options import SeeingOptions
from registration.inspection.pictures.picture import (
    Outlines,
    view_of,
    with_before,
)
from registration.inspection.pictures.rise import risen
from registration.inspection.values import (
    Appearance,
    ExpectedLines,
    Frame,
    Image,
    Lumen,
    Unseen,
)
from registration.inspection.ways import Ways, lay_ways

_STEPS_IN_GAP: Final = 4
_TELLS: Final = 3.0
"""Natural logarithm of odds by which a look must move what was believed of a place before it."""
_DOUBT: Final = (0.02, 0.5)
"""Probabilities of "bare" between which a place counts as not seen."""
_STRANGE: Final = 3.0
"""Spreads of its misfit, from which on a place doesn't look like ink that the model knows."""
_U_WIDTH: Final = 0.25
"""Relative standard uncertainty of lines' widths where a look tells none: beads scatter so."""
_SURELY_FULL: Final = 0.9
"""Probability from which on a place over older ink counts as full."""
_ALONE: Final = 1.25
"""Widths from middle to middle, from which on two lines have edges of their own."""
_END: Final = 0.6
"""Of a width from a line's end, within which it has no width of its own."""
_PART_SHOWN: Final = 0.25
"""Of a station's strips that show a sample, for their mean to be taken."""
_PART: Final = 0.7
"""Of a station, free on both sides, for its width to be told."""


def see_layer(
    picture: Image,
    frame: Frame,
    lines: ExpectedLines,
    *,
    lumens: Sequence[Lumen] = (),
    before: Image | None = None,
    stood_still: Callable[[], bool] | None = None,
    since: BoolArray | None = None,
    hidden: Outlines | BoolArray = (),
    known: Appearance | None = None,
    thickness_mm: float | None = None,
    options: SeeingOptions | None = None,
) -> LayerFindings:
    """Judge a picture of a layer.

    Parameters
    ----------
    picture : (h, w) or (h, w, c) uint8, uint16 or float
        A float picture is taken as it is, NaN as not seen; one of two channels is a `height_map`
        or of a `surface_of`: the first is judged, or heights. Of others the logarithm.
    frame : Frame
    lines : ExpectedLines
        Of the layer, and what older lines can be seen.
    lumens : sequence of Lumen
    before : picture or None
        The same view before the layer was written: what lay there then cancels, and fresh ink over
        older ink is told by what changed.
    stood_still : function or None
        Tells by marks whether the camera stood still in between; asked where a move is fitted.
    since : (n,) bool or None
        Older lines that were written after ``before`` was taken (mends); None for none.
    hidden : sequence of (k, 2) float64, px, or (h, w) bool
        Polygons of the picture behind which nothing can be seen (the needle), or its pixels.
    known : Appearance or None
        Of an earlier look in the same light: a layer that is missing altogether can't be learned
        from.
    thickness_mm : float or None, mm
        Of the layer: then the heights of such a picture are judged.
    options : SeeingOptions or None

    Raises
    ------
    PictureError
        When an argument can't be used, or the picture shows none of the lines.
    """
    options = options or SeeingOptions()
    check_type(options, SeeingOptions, "options")
    check_lines(lines)
    check_picture(picture, "the picture")
    check_frame(frame, np.concatenate([lines.start, lines.end]))
    check_lumens(lumens, "lumens")
    check_hidden(hidden, picture.shape)
    check_known(known)
    if thickness_mm is not None:
        check_thickness(thickness_mm)
    if since is not None:
        check_array(since, "since", BOOLS, (len(lines),))
    if before is not None:
        check_before(before, picture)
    ways = lay_ways(lines, options.gap_mm / _STEPS_IN_GAP)
    judged, unknown = picture, None
    if thickness_mm is not None:
        judged, unknown = risen(picture, frame, lines, thickness_mm, hidden)
    view, own = view_of(judged, frame, ways, options.gap_mm, hidden, unknown)
    if before is not None:
        late = np.zeros(len(lines), dtype=np.bool_) if since is None else since
        view = with_before(view, own, picture, before, lines, lines.fresh | late, stood_still)
    look = learned(view, own, lines, ways, options, known)
    return _findings(look, ways, lines, lumens, options, thickness_mm, known)


def _findings(
    look: Learned,
    ways: Ways,
    lines: ExpectedLines,
    lumens: Sequence[Lumen],
    options: SeeingOptions,
    thickness_mm: float | None,
    known: Appearance | None,
) -> LayerFindings:
    bare = np.asarray(look.judged.states[:, BARE] > 0.5)
    gaps = gaps_of(look, ways, bare)
    why = _reasons(look, ways, bare)
    places = max(1, round(float(ways.step[why == Unseen.SEEN].sum()) / options.gap_mm))
    for gap in gaps:
        if gap.p_value * places > options.false_rate:  # neither ink nor surely none
            why[(why == Unseen.SEEN) & gap.holds(ways.stroke, ways.along)] = int(Unseen.UNCLEAR)
    seen = why == Unseen.SEEN
    any_seen = bool(seen.any())
    group = Grouping.of_ways(ways)
    may_sag = look.view.is_heights and not lines.fresh.all()
    widths = _widths(look, ways, group, seen & (not may_sag), known)
    share = np.where(bare, 0.0, expected_ink(look.judged.states, look.judged.shares.share))
    stations = group.stations(ways, share, why, widths)
    ratio, u_ratio = width_ratio(stations, widths)
    seen_mm = float(stations.length_mm[stations.seen].sum())
    level = InkLevel.of(look)
    appearance = replace(look.appearance(), shapes=widths.usual.shapes)
    # Lines that look wider than they are narrow what lies between them.
    u_line_mm = min(u_ratio, _U_WIDTH) * float(np.median(ways.width))
    return LayerFindings(
        stations=stations,
        gaps=gaps,
        stretches=all_stretches(stations, widths, options.width_percent),
        blobs=level.blobs(look, ways, options.false_rate, thickness_mm),
        lumens=level.lumens(look, lumens, u_line_mm),
        width_ratio=ratio,
        u_width_ratio=u_ratio,
        u_width_change=widths.usual.u_change,
        seen_share=seen_mm / float(stations.length_mm.sum()),
        coverage=float(np.average(share[seen], weights=ways.step[seen])) if any_seen else math.nan,
        shift=look.shift
        if any_seen
        else replace(look.shift, covariance_mm2=np.full((2, 2), np.inf)),
        places=places,
        contrast=_contrast(look),
        appearance=appearance if any_seen else None,
        moved_px=look.view.moved_px,
    )


def _reasons(look: Learned, ways: Ways, bare: BoolArray) -> IntArray:
    """Why each place wasn't seen, (n,)."""
    state, old = look.judged.states, look.placed.old
    p = np.clip(state[:, BARE] / np.maximum(1.0 - state[:, HIDDEN], 1e-12), 1e-12, 1 - 1e-12)
    moved = np.abs(logit(p) - logit(PRIOR_BARE))
    why = np.full(len(ways), int(Unseen.SEEN))
    why[moved < _TELLS] = int(Unseen.FAINT)
    why[(moved < _TELLS) & old] = int(Unseen.OLD_INK)
    why[(p > _DOUBT[0]) & (p < _DOUBT[1]) & (moved >= _TELLS)] = int(Unseen.UNCLEAR)
    unlike = look.judged.misfit > look.judged.noise.misfit_full @ (1.0, _STRANGE)
    why[unlike & (moved >= _TELLS)] = int(Unseen.UNCLEAR)
    # How much changed doesn't tell how much ink came, nor what shade changes as much.
    vague = (state[:, FULL] < _SURELY_FULL) | ~look.judged.noise.full_is_told
    why[old & (look.view.change is not None) & vague & (moved >= _TELLS)] = int(Unseen.UNCLEAR)
    why[state[:, HIDDEN] > 0.5] = int(Unseen.GLARE)
    inside = look.placed.seen.inside(look.view.shape, 0.6 * ways.width)
    crossed = look.placed.crossed
    why[crossed & ~look.judged.shown] = int(Unseen.COVERED)
    why[look.judged.hidden] = int(Unseen.HIDDEN)
    why[~inside] = int(Unseen.OUTSIDE)
    why[bare & look.judged.shown] = int(Unseen.SEEN)
    return why


def _widths(
    look: Learned, ways: Ways, group: Grouping, seen: BoolArray, known: Appearance | None
) -> Widths:
    """Widths of stations over the bath with free sides; shares of ink of those that touch."""
    drawn = look.drawn
    beside = _beside(look)
    full = seen & (look.judged.states[:, BARE] < 0.1) & (ways.to_end > _END * ways.width)
    full &= ~look.placed.old  # a change doesn't tell how much ink came
    free = full & (beside > _ALONE)
    all_ = np.ones(len(ways), dtype=np.bool_)
    told = group.mean(free.astype(np.float64), all_) > _PART
    ink = measured(drawn.strips, drawn.own, StripNoise(look.judged.inverse), look.judged.lost)
    area = ink.share * (1.0 + ink.wider)
    touching = full & (beside <= _ALONE)
    seam = np.where(
        group.mean(touching.astype(np.float64), all_) > _PART, group.mean(area, touching), np.nan
    )
    shown = (~look.judged.lost).astype(np.float64)
    part = group.mean(shown, free)
    lost = ~(part > _PART_SHOWN)
    strips = group.mean(drawn.strips * shown[:, :, None], free)
    strips /= np.where(lost, 1.0, part)[:, :, None]
    own = group.mean(drawn.own, free)
    if look.odd:
        told = np.zeros_like(told)
    before = None if known is None else known.shapes
    usual = UsualWidth(shapes=before)
    if told.any():
        model = _of_stations(drawn.model, strips - own, told & ~lost.any(axis=1))
        usual = usual_ratio(model, look.view.is_heights, before)
    return station_widths(
        strips, own, lost, group.mean(free.astype(np.float64), all_) * group.count,
        ways.width[group.first], told, look.judged.inverse, usual, seam,
    )  # fmt: skip


def _of_stations(model: InkModel, left: FloatArray, use: BoolArray) -> InkModel:
    """Return profiles of the usual station: what a model leaves (m, u, c) in the median is added.

    Lines of several widths are drawn by one profile between theirs.
    """
    if not use.any():
        return model
    usual = np.median(left[use], axis=0)
    half = len(ACROSS) // 2
    even = 0.5 * (usual[half:] + usual[half::-1])
    node = np.arange(NODES + 1) * (REACH / NODES)
    profile = model.profile.copy()
    for c in range(even.shape[1]):
        profile[0, 0, :, c] += np.interp(node, ACROSS[half:], even[:, c], right=0.0)
    return replace(model, profile=profile)


def _beside(look: Learned) -> FloatArray:
    """Distance of each place to the nearest other fresh line, widths; `REACH` for none."""
    passes, kind = look.placed.passes, look.placed.pieces.kind
    at = np.rint(np.nan_to_num(look.placed.seen.at)).astype(np.int64)
    x = np.clip(at[:, 0], 0, look.view.shape[1] - 1)
    y = np.clip(at[:, 1], 0, look.view.shape[0] - 1)
    fresh = np.append(kind == 0, False)[passes.piece[y, x]]
    away = np.sort(np.where(fresh, np.abs(passes.distance[y, x]), REACH), axis=1)
    return np.asarray(np.minimum(away[:, 1], REACH), dtype=np.float64)


def _contrast(look: Learned) -> float:
    """Ink over bath, in standard deviations of a place as long as a tolerated gap."""
    spread = float(np.median(look.judged.noise.full))
    tie = float(np.median(look.judged.noise.tie))
    alike = 1.0 + 2.0 * sum((1 - k / _STEPS_IN_GAP) * tie**k for k in range(1, _STEPS_IN_GAP))
    return math.sqrt(_STEPS_IN_GAP / alike) / max(spread, 1e-9)
