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
from registration.inspection.ink.change import change_of
from registration.inspection.ink.drawing import Drawing, Drawn
from registration.inspection.ink.noise import BareStrips, Noise, learned_scatter
from registration.inspection.ink.shares import (
    ACROSS,
    Shares,
    StripNoise,
    beside_line,
    measured,
    strips_of,
)
from registration.inspection.values import FloatImage
from registration.inspection.ways import Ways

_UNSEEN: Final = 0.7
"""Of a strip's inner part that may be lost; what is left tells the less."""
_WHOLE: Final = 0.2
"""The same of strips by which ink's noise is learned; of a view that lost more, the better half."""
_INNER: Final = 0.6
"""Widths from a line's middle, within which a strip should be seen."""
_SAMPLE_LOST: Final = 0.1
"""Of a sample of a strip: it is lost where more of it is."""
_ENDS: Final = 0.5
"""Widths from a line's end, within which it isn't judged by itself: ink recedes or bulges there."""
_FAINTEST: Final = 0.05
"""Share that full lines of a class seem to hold; what holds less isn't ink."""
_FEWEST: Final = 4
"""Places by which the share of full lines is learned."""
_TOLD: Final = 3.5
"""Standard errors of the mean share from which on a profile is more than noise: without ink it
stayed below 2.5 in pictures of older ink alone."""
_KNOWN: Final = (0.5, 2.0)
"""Of the level that ink had in an earlier look in the same light."""
_SOME: Final = 0.1
"""Probability that a place isn't hidden, below which it is drawn with all of its ink."""
_LEAST_DRAWN: Final = 0.2
"""Share of ink that thin places are drawn with."""


@dataclass(frozen=True)
class Judged:
    """What is told of each place.

    Attributes
    ----------
    ways : Ways
        At their shift.
    lost : (n, u) bool
        Samples of strips that the picture doesn't show.
    shown : (n,) bool
        Places that the picture tells of.
    shares : Shares
    misfit : (n,) float64
        Logarithm of how badly any share of ink explains a place.
    noise : Noise
    inverse : (u c, u c) float64
        Inverse covariance of what strips hold beside their lines' own share and width: by it
        widths, and amounts of ink where lines touch, are compared along lines.
    """

    ways: Ways
    lost: BoolArray
    shown: BoolArray
    shares: Shares
    misfit: FloatArray
    noise: Noise
    inverse: FloatArray

    @cached_property
    def states(self) -> FloatArray:
        """Probabilities of full, thin, bare and hidden, (n, 4)."""
        return posterior(self.shown_share, self.misfit, self.noise, self.ways.run, self.ways.step)

    @property
    def shown_share(self) -> FloatArray:
        """Share of ink of each place, (n,); NaN where the picture doesn't tell."""
        return np.where(self.shown, self.shares.share, np.nan)

    @property
    def hidden(self) -> BoolArray:
        """Places of whose inner strip the picture shows too little, (n,)."""
        return np.asarray(_lost_part(self.lost) >= _UNSEEN)

    @property
    def present(self) -> FloatArray:
        """Share of its ink that each place is drawn with in the next round, (n,)."""
        known = self.states[:, :HIDDEN].sum(axis=1)
        there = 1.0 - self.states[:, BARE] / np.maximum(known, 1e-9)
        there = np.where(known > _SOME, there, 1.0)
        thin = np.clip(self.shares.share, _LEAST_DRAWN, 1.0)
        return np.asarray(np.where(self.states[:, THIN] > 0.5, thin, there))


def judge(look: Drawing, image: FloatImage, drawn: Drawn) -> Judged:
    """Judge the places of a view (h, w, c) without light."""
    placed, ways = drawn.placed, drawn.placed.ways
    cover = strips_of(look.view.lost[:, :, None].astype(np.float32), placed.seen, ways)
    lost = np.asarray(cover[:, :, 0] > _SAMPLE_LOST)
    part = _lost_part(lost)
    shown = placed.seen.inside(look.view.shape, 0.6 * ways.width) & (part < _UNSEEN)
    shown &= ~placed.crossed & (ways.to_end > _ENDS * ways.width)
    usual = float(np.median(part[shown])) if shown.any() else 0.0
    whole = shown & (part <= max(_WHOLE, usual))
    judged = _by_profile(look, image, drawn, lost, shown & ~placed.old, whole)
    if look.view.change is None or not placed.old.any():
        return judged
    return _by_change(look, image, drawn, judged, shown & placed.old)


def _by_profile(
    look: Drawing,
    image: FloatImage,
    drawn: Drawn,
    lost: BoolArray,
    shown: BoolArray,
    whole: BoolArray,
) -> Judged:
    """Judge places over the ground by their profile; ``whole`` (n,) are those seen whole."""
    placed, count, rows = drawn.placed, len(shown), ~drawn.placed.old
    shares, noise, misfit = Shares.blank(count), Noise.blank(count), np.zeros(count)
    if not rows.any():
        inverse = np.eye(math.prod(drawn.strips.shape[1:]))
        return Judged(placed.ways, lost, shown, shares, misfit, noise, inverse)
    good = whole & rows & (drawn.present > 0.5) & drawn.looks_full
    bare = BareStrips.laid(image - drawn.ink, placed, look.view.lost, rows)
    without = bare.strips if len(bare.strips) else drawn.strips[shown & ~drawn.looks_full]
    doubt = drawn.model.doubt_across(0, ACROSS)
    strip_noise, beside_lines = (
        StripNoise.of(_flat(rests), _flat(without), drawn.own[rows], doubt)
        for rests in (drawn.rest[good], beside_line(_flat(drawn.rest[good]), drawn.own[good]))
    )
    if look.prior is None and not (look.found and _is_told(drawn, strip_noise, shown)):
        shown = np.zeros_like(shown)
    found = measured(drawn.strips[rows], drawn.own[rows], strip_noise, lost[rows])
    top = _full_level(found.share[shown[rows]], look.prior is not None)
    shares.put(rows, found.over(top))
    misfit[rows] = np.log(np.maximum(found.misfit, 1e-9))
    # Slopes that light grazes along a line show little of it there.
    usual = float(np.median(shares.u_share[good if good.any() else rows]))
    dim = np.maximum(1.0, shares.u_share / max(usual, 1e-9))
    scatter = learned_scatter(
        1.0 + (shares.share - 1.0) / dim, usual, misfit, good, placed.ways.run, bare,
        drawn.own * top, strip_noise,
    )  # fmt: skip
    noise.put(rows, scatter, dim[rows])
    return Judged(placed.ways, lost, shown, shares, misfit, noise, beside_lines.inverse)


def _is_told(drawn: Drawn, noise: StripNoise, rows: BoolArray) -> bool:
    """Whether some ink shows by the profile that others tell; else a profile is noise."""
    if not rows.any():
        return False
    ways = drawn.placed.ways
    found = measured(drawn.strips[rows], drawn.by_others[rows], noise)
    independent = float((ways.step / ways.width)[rows].sum())
    spread = float(np.sqrt((found.u_share**2).mean()) / np.sqrt(max(independent, 1.0)))
    return float(found.share.mean()) > _TOLD * spread


def _by_change(
    look: Drawing, image: FloatImage, drawn: Drawn, judged: Judged, rows: BoolArray
) -> Judged:
    """Judge places over older ink, those of ``rows`` (n,), by how much changed there."""
    placed, inkless = drawn.placed, look.view.inkless
    changed = np.ascontiguousarray(image[:, :, inkless:])
    every = np.ones(len(rows), dtype=np.bool_)
    ground, beside = (
        BareStrips.laid(changed, placed, look.view.lost, every, beside=near).strips
        for near in (False, True)
    )
    found = change_of(
        strips_of(changed, placed.seen, placed.ways)[rows], drawn.own[rows][:, :, inkless:],
        judged.lost[rows], ground, beside, drawn.present[rows] > 0.5, placed.ways.run[rows],
    )  # fmt: skip
    if found is None:
        return judged
    judged.shares.share[rows], judged.misfit[rows] = found.share, found.misfit
    judged.noise.put(rows, found.scatter)
    return replace(judged, shown=judged.shown | rows)


def _lost_part(lost: BoolArray) -> FloatArray:
    return np.asarray(lost[:, np.abs(ACROSS) < _INNER].mean(axis=1))


def _flat(strips: FloatArray) -> FloatArray:
    return strips.reshape(len(strips), math.prod(strips.shape[1:]))


def _full_level(share: FloatArray, is_known: bool) -> float:
    """Usual share of lines that have ink, of which some may be missing; 1 for too little."""
    level = 1.0
    if len(share) >= _FEWEST:
        level = float(np.percentile(share, 80))
        for _ in range(4):
            upper = share[share > 0.5 * level]
            level = float(np.median(upper)) if len(upper) else level
        level = level if level > _FAINTEST else 1.0
    return min(max(level, _KNOWN[0]), _KNOWN[1]) if is_known else level
