"""Judge a layer by its picture, height map or scan picture.

1. The picture is cropped and binned, and the one before laid over it (`pictures`).
2. Light, the layer's shift, ink's profile across a line, and the share of ink at each place are
   estimated in turn (`ink.learn`): a view is ground plus profiles along lines.
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
from printctl.inspection.findings import LayerFindings
from printctl.inspection.found.gaps import find_gaps
from printctl.inspection.found.ink_level import InkLevel
from printctl.inspection.found.line_width import (
    U_WIDTH_BEFORE,
    StationWidths,
    UsualWidth,
    estimate_width_ratio,
    station_widths,
)
from printctl.inspection.found.stations import StationGrouping
from printctl.inspection.found.stretches import find_all_stretches, width_ratio
from printctl.inspection.ink.chain import BARE, FULL, HIDDEN, PRIOR_BARE, expected_ink
from printctl.inspection.ink.ink_model import NODES, InkModel
from printctl.inspection.ink.learn import LayerFit, fit_layer
from printctl.inspection.ink.passes import REACH_WIDTHS
from printctl.inspection.ink.shares import ACROSS_WIDTHS, StripNoise, measure_shares
from printctl.inspection.inputs import (
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
from printctl.inspection.options import SeeingOptions
from printctl.inspection.path_samples import PathSamples, sample_paths
from printctl.inspection.pictures.picture import (
    Outlines,
    add_change,
    crop_view,
)
from printctl.inspection.pictures.rise import rise_over_floor
from printctl.inspection.values import (
    Appearance,
    ExpectedLines,
    Frame,
    Image,
    Lumen,
    Unseen,
)

_SAMPLES_PER_GAP: Final = 4
"""Places along a line in the length of the shortest gap."""
_MIN_LOG_ODDS_CHANGE: Final = 3.0
"""Least change that a look makes to a place's log odds of being bare for it to count as seen."""
_UNCLEAR_PROBABILITIES: Final = (0.02, 0.5)
"""Probabilities of "bare" between which a place counts as unclear, so not seen."""
_MAX_MISFIT_SPREADS: Final = 3.0
"""Spreads above the usual misfit at which a place no longer looks like modelled ink."""
_MIN_FULL_PROBABILITY: Final = 0.9
"""Least probability of full ink for a place over older ink to count as seen."""
_MIN_FREE_WIDTHS: Final = 1.25
"""Least distance between two lines' middles at which each has free edges, in widths."""
_END_WIDTHS: Final = 0.6
"""Length at a line's end, in widths, where its width isn't measured."""
_MIN_SHOWN_SHARE: Final = 0.25
"""Least share of a station's strips that show a sample for its mean to be used."""
_MIN_FREE_SHARE: Final = 0.7
"""Least share of a station with free sides for its width to be measured."""


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
        A float picture is used as given, NaN as not seen; one of two channels is a `height_map` or
        a `surface_of`, of which the first is judged, or heights. Others are judged by logarithms.
    frame : Frame
    lines : ExpectedLines
        Of the layer, and what older lines can be seen.
    lumens : sequence of Lumen
    before : picture or None
        The same view before the layer was written: earlier contents cancel, and fresh ink over
        older ink is judged by what changed.
    stood_still : function or None
        Returns whether marks show that the camera stood still in between; called where a move is
        fitted.
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
    samples = sample_paths(lines, options.gap_mm / _SAMPLES_PER_GAP)
    inspected, unknown = picture, None
    if thickness_mm is not None:
        inspected, unknown = rise_over_floor(picture, frame, lines, thickness_mm, hidden)
    view, own = crop_view(inspected, frame, samples, options.gap_mm, hidden, unknown)
    if before is not None:
        late = np.zeros(len(lines), dtype=np.bool_) if since is None else since
        view = add_change(view, own, picture, before, lines, lines.fresh | late, stood_still)
    look = fit_layer(view, own, lines, samples, options, known)
    return _findings(look, samples, lines, lumens, options, thickness_mm, known)


def _findings(
    look: LayerFit,
    samples: PathSamples,
    lines: ExpectedLines,
    lumens: Sequence[Lumen],
    options: SeeingOptions,
    thickness_mm: float | None,
    known: Appearance | None,
) -> LayerFindings:
    bare = np.asarray(look.ink_states.probability[:, BARE] > 0.5)
    gaps, p_value = find_gaps(look, samples, bare)
    why = _unseen_reasons(look, samples, bare)
    places = max(1, round(float(samples.step[why == Unseen.SEEN].sum()) / options.gap_mm))
    # Neither ink nor surely none.
    why[(why == Unseen.SEEN) & bare & (p_value * places > options.false_rate)] = int(Unseen.UNCLEAR)
    seen = why == Unseen.SEEN
    any_seen = bool(seen.any())
    group = StationGrouping.of_samples(samples)
    may_sag = look.view.is_heights and not lines.fresh.all()
    widths = _measure_widths(look, samples, group, seen & (not may_sag), known)
    share = np.where(
        bare, 0.0, expected_ink(look.ink_states.probability, look.ink_states.shares.share)
    )
    stations = group.stations(samples, share, why, widths)
    ratio, u_ratio = width_ratio(stations, widths)
    seen_mm = float(stations.length_mm[stations.seen].sum())
    level = InkLevel.of(look)
    appearance = replace(look.appearance(), shapes=widths.usual.shapes)
    # Lines that look wider than they are narrow what lies between them.
    u_line_mm = min(u_ratio, U_WIDTH_BEFORE) * float(np.median(samples.width))
    return LayerFindings(
        stations=stations,
        gaps=gaps,
        stretches=find_all_stretches(stations, widths, options.width_percent),
        blobs=level.blobs(look, samples, options.false_rate, thickness_mm),
        lumens=level.lumens(look, lumens, u_line_mm),
        width_ratio=ratio,
        u_width_ratio=u_ratio,
        u_width_change=widths.usual.u_change,
        seen_share=seen_mm / float(stations.length_mm.sum()),
        coverage=float(np.average(share[seen], weights=samples.step[seen]))
        if any_seen
        else math.nan,
        shift=look.shift
        if any_seen
        else replace(look.shift, covariance_mm2=np.full((2, 2), np.inf)),
        places=places,
        contrast=_contrast(look),
        appearance=appearance if any_seen else None,
        moved_px=look.view.moved_px,
    )


def _unseen_reasons(look: LayerFit, samples: PathSamples, bare: BoolArray) -> IntArray:
    """Return why each place wasn't seen, `Unseen` (n,)."""
    state, old = look.ink_states.probability, look.shifted.old
    p = np.clip(state[:, BARE] / np.maximum(1.0 - state[:, HIDDEN], 1e-12), 1e-12, 1 - 1e-12)
    moved = np.abs(logit(p) - logit(PRIOR_BARE))
    why = np.full(len(samples), int(Unseen.SEEN))
    why[moved < _MIN_LOG_ODDS_CHANGE] = int(Unseen.FAINT)
    why[(moved < _MIN_LOG_ODDS_CHANGE) & old] = int(Unseen.OLD_INK)
    why[
        (p > _UNCLEAR_PROBABILITIES[0])
        & (p < _UNCLEAR_PROBABILITIES[1])
        & (moved >= _MIN_LOG_ODDS_CHANGE)
    ] = int(Unseen.UNCLEAR)
    unlike = look.ink_states.misfit > look.ink_states.noise.misfit_full @ (1.0, _MAX_MISFIT_SPREADS)
    why[unlike & (moved >= _MIN_LOG_ODDS_CHANGE)] = int(Unseen.UNCLEAR)
    # A change's size gives no amount of ink, and shade may change a view as much.
    vague = (state[:, FULL] < _MIN_FULL_PROBABILITY) | ~look.ink_states.noise.full_is_distinct
    why[old & (look.view.change is not None) & vague & (moved >= _MIN_LOG_ODDS_CHANGE)] = int(
        Unseen.UNCLEAR
    )
    why[state[:, HIDDEN] > 0.5] = int(Unseen.GLARE)
    inside = look.shifted.projected.inside(look.view.shape, 0.6 * samples.width)
    crossed = look.shifted.crossed
    why[crossed & ~look.ink_states.shown] = int(Unseen.COVERED)
    why[look.ink_states.hidden] = int(Unseen.HIDDEN)
    why[~inside] = int(Unseen.OUTSIDE)
    why[bare & look.ink_states.shown] = int(Unseen.SEEN)
    return why


def _measure_widths(
    look: LayerFit,
    samples: PathSamples,
    group: StationGrouping,
    seen: BoolArray,
    known: Appearance | None,
) -> StationWidths:
    """Measure widths of stations with free sides, and shares of ink where lines touch."""
    view_fit = look.view_fit
    beside = _distance_to_neighbour(look)
    full = (
        seen
        & (look.ink_states.probability[:, BARE] < 0.1)
        & (samples.to_end > _END_WIDTHS * samples.width)
    )
    full &= ~look.shifted.old  # a change gives no amount of ink
    free = full & (beside > _MIN_FREE_WIDTHS)
    all_ = np.ones(len(samples), dtype=np.bool_)
    measurable = group.mean(free.astype(np.float64), all_) > _MIN_FREE_SHARE
    ink = measure_shares(
        view_fit.strips, view_fit.own, StripNoise(look.ink_states.inverse), look.ink_states.lost
    )
    area = ink.share * (1.0 + ink.widening)
    touching = full & (beside <= _MIN_FREE_WIDTHS)
    seam = np.where(
        group.mean(touching.astype(np.float64), all_) > _MIN_FREE_SHARE,
        group.mean(area, touching),
        np.nan,
    )
    shown = (~look.ink_states.lost).astype(np.float64)
    part = group.mean(shown, free)
    lost = ~(part > _MIN_SHOWN_SHARE)
    strips = group.mean(view_fit.strips * shown[:, :, None], free)
    strips /= np.where(lost, 1.0, part)[:, :, None]
    own = group.mean(view_fit.own, free)
    if look.odd:
        measurable = np.zeros_like(measurable)
    before = None if known is None else known.shapes
    usual = UsualWidth(shapes=before)
    if measurable.any():
        model = _with_station_profile(view_fit.model, strips - own, measurable & ~lost.any(axis=1))
        usual = estimate_width_ratio(model, look.view.is_heights, before)
    return station_widths(
        strips, own, lost, group.mean(free.astype(np.float64), all_) * group.count,
        samples.width[group.first], measurable, look.ink_states.inverse, usual, seam,
    )  # fmt: skip


def _with_station_profile(model: InkModel, left: FloatArray, use: BoolArray) -> InkModel:
    """Add the stations' median rest (m, u, c) to the model's profile.

    Lines of several widths are drawn by one profile between theirs.
    """
    if not use.any():
        return model
    usual = np.median(left[use], axis=0)
    half = len(ACROSS_WIDTHS) // 2
    flat_view = 0.5 * (usual[half:] + usual[half::-1])
    node = np.arange(NODES + 1) * (REACH_WIDTHS / NODES)
    profile = model.profile.copy()
    for c in range(flat_view.shape[1]):
        profile[0, 0, :, c] += np.interp(node, ACROSS_WIDTHS[half:], flat_view[:, c], right=0.0)
    return replace(model, profile=profile)


def _distance_to_neighbour(look: LayerFit) -> FloatArray:
    """Return each place's distance to the nearest other fresh line, widths; at most the reach."""
    passes, kind = look.shifted.passes, look.shifted.pieces.kind
    at = np.rint(np.nan_to_num(look.shifted.projected.at)).astype(np.int64)
    x = np.clip(at[:, 0], 0, look.view.shape[1] - 1)
    y = np.clip(at[:, 1], 0, look.view.shape[0] - 1)
    fresh = np.append(kind == 0, False)[passes.piece[y, x]]
    away = np.sort(np.where(fresh, np.abs(passes.distance[y, x]), REACH_WIDTHS), axis=1)
    return np.asarray(np.minimum(away[:, 1], REACH_WIDTHS), dtype=np.float64)


def _contrast(look: LayerFit) -> float:
    """Return ink over bath, in standard deviations of a place as long as a tolerated gap."""
    spread = float(np.median(look.ink_states.noise.full))
    correlation = float(np.median(look.ink_states.noise.correlation))
    alike = 1.0 + 2.0 * sum(
        (1 - k / _SAMPLES_PER_GAP) * correlation**k for k in range(1, _SAMPLES_PER_GAP)
    )
    return math.sqrt(_SAMPLES_PER_GAP / alike) / max(spread, 1e-9)
