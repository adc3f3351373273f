"""Judge each place of a drawn view: its share of ink, and how likely it is full, thin or bare.

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
from registration.inspection.ink.chain import BARE, HIDDEN, THIN, posterior
from registration.inspection.ink.change import measure_change
from registration.inspection.ink.noise import MIN_FULL_PLACES, BareStrips, Noise, learn_scatter
from registration.inspection.ink.shares import (
    ACROSS_WIDTHS,
    InkShares,
    StripNoise,
    measure_shares,
    remove_line_terms,
    sample_strips,
)
from registration.inspection.ink.view_fit import ViewFit, ViewFitter
from registration.inspection.path_samples import PathSamples
from registration.inspection.values import FloatImage

_MAX_LOST_SHARE: Final = 0.7
"""Of a strip's inner part that may be lost; what is left tells the less."""
_MAX_LOST_SHARE_LEARNED: Final = 0.2
"""The same of strips by which ink's noise is learned; of a view that lost more, the better half."""
_INNER_WIDTHS: Final = 0.6
"""Widths from a line's middle, within which a strip should be seen."""
_MAX_SAMPLE_LOST_SHARE: Final = 0.1
"""Of a sample of a strip: it is lost where more of it is."""
_END_WIDTHS: Final = 0.5
"""Widths from a line's end, within which it isn't judged by itself: ink recedes or bulges there."""
_MIN_FULL_SHARE: Final = 0.05
"""Share that full lines of a class seem to hold; what holds less isn't ink."""
_MIN_STANDARD_ERRORS: Final = 3.5
"""Standard errors of the mean share from which on a profile is more than noise: without ink it
stayed below 2.5 in pictures of older ink alone."""
_LEVEL_LIMITS: Final = (0.5, 2.0)
"""Of the level that ink had in an earlier look in the same light."""
_MIN_SEEN_PROBABILITY: Final = 0.1
"""Probability that a place isn't hidden, below which it is drawn with all of its ink."""
_MIN_THIN_SHARE: Final = 0.2
"""Share of ink that thin places are drawn with."""


@dataclass(frozen=True)
class InkStates:
    """What is told of each place.

    Attributes
    ----------
    samples : PathSamples
        At their shift.
    lost : (n, u) bool
        Samples of strips that the picture doesn't show.
    shown : (n,) bool
        Places that the picture tells of.
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
        """Share of ink of each place, (n,); NaN where the picture doesn't tell."""
        return np.where(self.shown, self.shares.share, np.nan)

    @property
    def hidden(self) -> BoolArray:
        """Places of whose inner strip the picture shows too little, (n,)."""
        return np.asarray(_lost_part(self.lost) >= _MAX_LOST_SHARE)

    @property
    def present(self) -> FloatArray:
        """Share of its ink that each place is drawn with in the next round, (n,)."""
        known = self.probability[:, :HIDDEN].sum(axis=1)
        there = 1.0 - self.probability[:, BARE] / np.maximum(known, 1e-9)
        there = np.where(known > _MIN_SEEN_PROBABILITY, there, 1.0)
        thin = np.clip(self.shares.share, _MIN_THIN_SHARE, 1.0)
        return np.asarray(np.where(self.probability[:, THIN] > 0.5, thin, there))


def judge(fitter: ViewFitter, image: FloatImage, view_fit: ViewFit) -> InkStates:
    """Judge the places of a view (h, w, c) without light."""
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
    """Judge places over the ground by their profile; ``whole`` (n,) are those seen whole."""
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
        fitter.found and _is_significant(view_fit, strip_noise, shown)
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
    """Whether some ink shows by the profile that others tell; else a profile is noise."""
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
    """Judge places over older ink, those of ``rows`` (n,), by how much changed there."""
    shifted, inkless = view_fit.shifted, fitter.view.inkless
    changed = np.ascontiguousarray(image[:, :, inkless:])
    every = np.ones(len(rows), dtype=np.bool_)
    ground, beside = (
        BareStrips.sample(changed, shifted, fitter.view.lost, every, beside=near).strips
        for near in (False, True)
    )
    found = measure_change(
        sample_strips(changed, shifted.projected, shifted.samples)[rows], view_fit.own[rows][:, :, inkless:],
        ink_states.lost[rows], ground, beside, view_fit.present[rows] > 0.5, shifted.samples.run[rows],
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
    """Usual share of lines that have ink, of which some may be missing; 1 for too little."""
    level = 1.0
    if len(share) >= MIN_FULL_PLACES:
        level = float(np.percentile(share, 80))
        for _ in range(4):
            upper = share[share > 0.5 * level]
            level = float(np.median(upper)) if len(upper) else level
        level = level if level > _MIN_FULL_SHARE else 1.0
    return min(max(level, _LEVEL_LIMITS[0]), _LEVEL_LIMITS[1]) if is_known else level
