"""Estimate each place's share of ink and its state's probabilities.

Places are judged by the profile of their class, over the ground or over older ink; those over older
ink by what changed since a picture before, where there is one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.ink.chain import BARE, HIDDEN, THIN, posterior
from printctl.inspection.ink.change import measure_change
from printctl.inspection.ink.noise import MIN_FULL_PLACES, BareStrips, Noise, learn_scatter
from printctl.inspection.ink.shares import (
    ACROSS_WIDTHS,
    InkShares,
    StripNoise,
    measure_shares,
    remove_line_terms,
    sample_strips,
)
from printctl.inspection.ink.view_fit import ViewFit, ViewFitter
from printctl.inspection.path_samples import PathSamples
from printctl.inspection.values import FloatImage

_MAX_LOST_SHARE: Final = 0.7
"""Share of a strip's inner part that may be lost."""
_MAX_LOST_SHARE_LEARNED: Final = 0.2
"""The same for strips from which noise is learned; in views that lost more, the median."""
_INNER_WIDTHS: Final = 0.6
"""Half width of a strip's inner part, in widths."""
_MAX_SAMPLE_LOST_SHARE: Final = 0.1
"""Share of a sample's pixels above which it counts as lost."""
_END_WIDTHS: Final = 0.5
"""Length at a line's end, in widths, that isn't judged: ink recedes or bulges there."""
_MIN_FULL_SHARE: Final = 0.05
"""Least usual share of full lines; lower ones aren't ink."""
_MIN_STANDARD_ERRORS: Final = 3.5
"""Least mean share in its standard errors for a profile to be ink, not noise: without ink it stayed
below 2.5 in pictures of older ink alone."""
_LEVEL_LIMITS: Final = (0.5, 2.0)
"""Limits of ink's level relative to an earlier look in the same light."""
_MIN_SEEN_PROBABILITY: Final = 0.1
"""Least probability of a place not being hidden; below it is rendered with full ink."""
_MIN_THIN_SHARE: Final = 0.2
"""Least share of ink that thin places are rendered with."""


@dataclass(frozen=True)
class InkStates:
    """Measured shares of ink, their noise and the states' probabilities at each place.

    Attributes
    ----------
    samples : PathSamples
        At their shift.
    lost : (n, u) bool
        Samples of strips that the picture lost.
    shown : (n,) bool
        Places that the picture shows.
    shares : InkShares
    misfit : (n,) float64
        Logarithm of how badly any share of ink explains a place.
    noise : Noise
    inverse : (u c, u c) float64
        Inverse covariance of what strips hold beside their lines' own share and width: by it
        widths, and amounts of ink where lines touch, are compared along lines.
    """

    samples: PathSamples
    lost: BoolArray
    shown: BoolArray
    shares: InkShares
    misfit: FloatArray
    noise: Noise
    inverse: FloatArray

    @cached_property
    def probability(self) -> FloatArray:
        """Probabilities of full, thin, bare and hidden, (n, 4)."""
        return posterior(
            self.shown_share, self.misfit, self.noise, self.samples.run, self.samples.step
        )

    @property
    def shown_share(self) -> FloatArray:
        """Share of ink at each place, (n,); NaN where not shown."""
        return np.where(self.shown, self.shares.share, np.nan)

    @property
    def hidden(self) -> BoolArray:
        """Places whose inner strip lost too much, (n,)."""
        return np.asarray(_lost_part(self.lost) >= _MAX_LOST_SHARE)

    @property
    def present(self) -> FloatArray:
        """Share of ink that each place is rendered with in the next round, (n,)."""
        known = self.probability[:, :HIDDEN].sum(axis=1)
        there = 1.0 - self.probability[:, BARE] / np.maximum(known, 1e-9)
        there = np.where(known > _MIN_SEEN_PROBABILITY, there, 1.0)
        thin = np.clip(self.shares.share, _MIN_THIN_SHARE, 1.0)
        return np.asarray(np.where(self.probability[:, THIN] > 0.5, thin, there))


def judge(fitter: ViewFitter, image: FloatImage, view_fit: ViewFit) -> InkStates:
    """Judge the places of a view ``image`` (h, w, c) without light."""
    shifted, samples = view_fit.shifted, view_fit.shifted.samples
    cover = sample_strips(
        fitter.view.lost[:, :, None].astype(np.float32), shifted.projected, samples
    )
    lost = np.asarray(cover[:, :, 0] > _MAX_SAMPLE_LOST_SHARE)
    part = _lost_part(lost)
    shown = shifted.projected.inside(fitter.view.shape, 0.6 * samples.width) & (
        part < _MAX_LOST_SHARE
    )
    shown &= ~shifted.crossed & (samples.to_end > _END_WIDTHS * samples.width)
    usual = float(np.median(part[shown])) if shown.any() else 0.0
    whole = shown & (part <= max(_MAX_LOST_SHARE_LEARNED, usual))
    ink_states = _by_profile(fitter, image, view_fit, lost, shown & ~shifted.old, whole)
    if fitter.view.change is None or not shifted.old.any():
        return ink_states
    return _by_change(fitter, image, view_fit, ink_states, shown & shifted.old)


def _by_profile(
    fitter: ViewFitter,
    image: FloatImage,
    view_fit: ViewFit,
    lost: BoolArray,
    shown: BoolArray,
    whole: BoolArray,
) -> InkStates:
    """Judge places over the ground by their profile; ``whole`` (n,) are unobstructed ones."""
    shifted, count, rows = view_fit.shifted, len(shown), ~view_fit.shifted.old
    shares, noise, misfit = InkShares.blank(count), Noise.blank(count), np.zeros(count)
    if not rows.any():
        inverse = np.eye(math.prod(view_fit.strips.shape[1:]))
        return InkStates(shifted.samples, lost, shown, shares, misfit, noise, inverse)
    good = whole & rows & (view_fit.present > 0.5) & view_fit.looks_full
    bare = BareStrips.sample(image - view_fit.ink, shifted, fitter.view.lost, rows)
    without = bare.strips if len(bare.strips) else view_fit.strips[shown & ~view_fit.looks_full]
    doubt = view_fit.model.covariance_across(0, ACROSS_WIDTHS)
    strip_noise, beside_lines = (
        StripNoise.of(_flat(rests), _flat(without), view_fit.own[rows], doubt)
        for rests in (
            view_fit.rest[good],
            remove_line_terms(_flat(view_fit.rest[good]), view_fit.own[good]),
        )
    )
    if fitter.prior is None and not (
        fitter.lines_found and _is_significant(view_fit, strip_noise, shown)
    ):
        shown = np.zeros_like(shown)
    found = measure_shares(view_fit.strips[rows], view_fit.own[rows], strip_noise, lost[rows])
    top = _full_level(found.share[shown[rows]], fitter.prior is not None)
    shares.put(rows, found.over(top))
    misfit[rows] = np.log(np.maximum(found.misfit, 1e-9))
    # Slopes that light grazes along a line show little of it there.
    usual = float(np.median(shares.u_share[good if good.any() else rows]))
    dim = np.maximum(1.0, shares.u_share / max(usual, 1e-9))
    scatter = learn_scatter(
        1.0 + (shares.share - 1.0) / dim, usual, misfit, good, shifted.samples.run, bare,
        view_fit.own * top, strip_noise,
    )  # fmt: skip
    noise.put(rows, scatter, dim[rows])
    return InkStates(shifted.samples, lost, shown, shares, misfit, noise, beside_lines.inverse)


def _is_significant(view_fit: ViewFit, noise: StripNoise, rows: BoolArray) -> bool:
    """Return whether the mean share by cross-fitted profiles is significant."""
    if not rows.any():
        return False
    samples = view_fit.shifted.samples
    found = measure_shares(view_fit.strips[rows], view_fit.by_others[rows], noise)
    independent = float((samples.step / samples.width)[rows].sum())
    spread = float(np.sqrt((found.u_share**2).mean()) / np.sqrt(max(independent, 1.0)))
    return float(found.share.mean()) > _MIN_STANDARD_ERRORS * spread


def _by_change(
    fitter: ViewFitter, image: FloatImage, view_fit: ViewFit, ink_states: InkStates, rows: BoolArray
) -> InkStates:
    """Judge the places ``rows`` (n,) over older ink by the view's change there."""
    shifted, inkless = view_fit.shifted, fitter.view.inkless
    changed = np.ascontiguousarray(image[:, :, inkless:])
    every = np.ones(len(rows), dtype=np.bool_)
    ground, beside = (
        BareStrips.sample(changed, shifted, fitter.view.lost, every, beside=near).strips
        for near in (False, True)
    )
    found = measure_change(
        sample_strips(changed, shifted.projected, shifted.samples)[rows],
        view_fit.own[rows][:, :, inkless:], ink_states.lost[rows], ground, beside,
        view_fit.present[rows] > 0.5, shifted.samples.run[rows],
    )  # fmt: skip
    if found is None:
        return ink_states
    ink_states.shares.share[rows], ink_states.misfit[rows] = found.share, found.misfit
    ink_states.noise.put(rows, found.scatter)
    return replace(ink_states, shown=ink_states.shown | rows)


def _lost_part(lost: BoolArray) -> FloatArray:
    return np.asarray(lost[:, np.abs(ACROSS_WIDTHS) < _INNER_WIDTHS].mean(axis=1))


def _flat(strips: FloatArray) -> FloatArray:
    return strips.reshape(len(strips), math.prod(strips.shape[1:]))


def _full_level(share: FloatArray, is_known: bool) -> float:
    """Return the usual share of lines with ink, of which some may be missing; 1 for too few."""
    level = 1.0
    if len(share) >= MIN_FULL_PLACES:
        level = float(np.percentile(share, 80))
        for _ in range(4):
            upper = share[share > 0.5 * level]
            level = float(np.median(upper)) if len(upper) else level
        level = level if level > _MIN_FULL_SHARE else 1.0
    return min(max(level, _LEVEL_LIMITS[0]), _LEVEL_LIMITS[1]) if is_known else level
