"""Fit ink profiles to a view, render it, and sample strips."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.inspection.ink.ink_model import CrossFit, InkModel, ShareOfPiece, fit_profiles
from printctl.inspection.ink.passes import Passes, Pieces
from printctl.inspection.ink.shares import ACROSS_WIDTHS, full_ink_profile, sample_strips
from printctl.inspection.options import SeeingOptions
from printctl.inspection.path_samples import PathSamples, ProjectedSamples
from printctl.inspection.pictures.picture import View, ViewFrame
from printctl.inspection.values import ExpectedLines, FloatImage, Shift

_NO_OLD_INK_WIDTHS: Final = 0.65
"""Distance from an older line's middle beyond which there is none of its ink."""
_FULL_OLD_INK_WIDTHS: Final = 0.35
"""Distance from an older line's middle within which all of its ink lies."""
_MIN_OLD_INK_SHARE: Final = 0.05
"""Share of a place's width over older ink above which it is judged against that ink."""
_INDEPENDENT_WIDTHS: Final = 0.4
"""Distance in widths below which pixels aren't independent."""
_GROUP_WIDTHS: Final = 2.0
"""Length in widths of the pieces that alternate between the two cross-fit groups."""
_MIN_GROUPS: Final = 4
"""Least number of pieces in a layer; in short layers pieces are shorter."""


@dataclass(frozen=True)
class ShiftedLines:
    """Lines and their sample points at one shift of the layer.

    Attributes
    ----------
    samples : PathSamples
        Moved by the shift.
    projected : ProjectedSamples
    pieces : Pieces
    passes : Passes
    """

    samples: PathSamples
    projected: ProjectedSamples
    pieces: Pieces
    passes: Passes

    @cached_property
    def over(self) -> FloatImage:
        """Share of older ink at each pixel, 0 to 1, (h, w)."""
        older = self.passes.near[:, :, 1]
        over = np.clip(
            (_NO_OLD_INK_WIDTHS - older) / (_NO_OLD_INK_WIDTHS - _FULL_OLD_INK_WIDTHS), 0.0, 1.0
        )
        return np.asarray(over, dtype=np.float32)

    @cached_property
    def over_across(self) -> FloatArray:
        """Share of older ink across each place, (n, u)."""
        return sample_strips(self.over[:, :, None], self.projected, self.samples)[:, :, 0]

    @cached_property
    def old(self) -> BoolArray:
        """Places over older ink, (n,)."""
        return np.asarray(
            self.over_across[:, np.abs(ACROSS_WIDTHS) <= 0.5].mean(axis=1) > _MIN_OLD_INK_SHARE
        )

    @cached_property
    def crossed(self) -> BoolArray:
        """Places over or under which the view shows another of the layer's lines, (n,)."""
        return self.samples.crossed_in(self.projected)


@dataclass(frozen=True)
class ViewFit:
    """Ink model of a view at one shift, and the view's strips.

    Attributes
    ----------
    shifted : ShiftedLines
    present : (n,) float64
        Share of ink that each place was rendered with.
    model : InkModel
    ink : (h, w, c) float32
        The rendered model.
    own : (n, u, c) float64
        Full ink's profile across each place.
    by_others : (n, u, c) float64
        The same by a profile fitted without the place itself, unless one is known.
    strips : (n, u, c) float64
        The view across each place, less all other rendered ink.
    """

    shifted: ShiftedLines
    present: FloatArray
    model: InkModel
    ink: FloatImage
    own: FloatArray
    by_others: FloatArray
    strips: FloatArray

    @cached_property
    def rest(self) -> FloatArray:
        """Rest of the strips that the model doesn't explain, (n, u, c)."""
        return self.strips - self.present[:, None, None] * self.own

    @cached_property
    def looks_full(self) -> BoolArray:
        """Strips nearer to full ink than to none, (n,)."""
        return np.asarray(((self.strips - 0.5 * self.own) * self.own).sum(axis=(1, 2)) > 0.0)


@dataclass(frozen=True)
class ViewFitter:
    """Inputs of a look's fit, the same in all rounds.

    Attributes
    ----------
    view : View
    frame : ViewFrame
    lines : ExpectedLines
    samples : PathSamples
        Places along the fresh lines, as designed.
    options : SeeingOptions
    prior : InkModel or None
        Profiles known beforehand.
    odd : bool
        Whether ink shows by slopes lit from one side alone.
    lines_found : bool
        Whether lines explain the view better at their place than beside it.
    """

    view: View
    frame: ViewFrame
    lines: ExpectedLines
    samples: PathSamples
    options: SeeingOptions
    prior: InkModel | None
    odd: bool
    lines_found: bool

    @cached_property
    def group(self) -> IntArray:
        """Cross-fit group 0 or 1 of each place in turns along the line, (n + 1,); 2 at the end."""
        at = self.samples.along / self.samples.width
        length = float((self.samples.step / self.samples.width).sum())
        piece = min(_GROUP_WIDTHS, length / _MIN_GROUPS)
        return np.append(((at / piece).astype(np.int64) + self.samples.stroke) % 2, 2)

    def lines_at(self, shift: Shift, last: ShiftedLines | None = None) -> ShiftedLines:
        """Return lines at a shift; reuse the ``last`` round's where they haven't moved."""
        by = np.array([shift.dx_mm, shift.dy_mm])
        there = self.samples.moved(by)
        if last is not None and np.array_equal(there.point, last.samples.point):
            return last
        off = np.where(self.lines.fresh[:, None], np.append(by, 0.0), 0.0)
        moved = replace(self.lines, start=self.lines.start + off, end=self.lines.end + off)
        pieces = Pieces.of(moved, self.frame)
        projected = ProjectedSamples.of(there, self.frame, self.options.round_lines)
        return ShiftedLines(there, projected, pieces, Passes.of(pieces, self.view.shape))

    def initial_share(self, image: FloatImage, shifted: ShiftedLines) -> FloatArray:
        """Return 1 where a known profile shows ink, else 0, (n,); 1 everywhere without one.

        Of touching lines that are all bare each would look full beside the others' rendered ink.
        """
        if self.prior is None:
            return np.ones(len(self.samples))
        samples, projected = shifted.samples, shifted.projected
        core = np.abs(ACROSS_WIDTHS) <= _FULL_OLD_INK_WIDTHS
        measured = (~self.view.lost)[:, :, None].astype(np.float32)
        shown = sample_strips(measured, projected, samples)[:, core]
        nothing_below = np.zeros((len(samples), len(ACROSS_WIDTHS)))
        own = full_ink_profile(self.prior, nothing_below, projected)[:, core] * shown
        power = (own**2).sum(axis=(1, 2))
        share = (sample_strips(image, projected, samples)[:, core] * own).sum(axis=(1, 2))
        return np.asarray((share > 0.5 * power) | (power <= 0.0), dtype=np.float64)

    def fit(
        self,
        image: FloatImage,
        shifted: ShiftedLines,
        present: FloatArray,
        level: FloatArray,
        parts: tuple[int, ...] | None,
    ) -> ViewFit:
        """Fit profiles of these parts, or take known ones (None), and render the view.

        Parameters
        ----------
        image : (h, w, c) float32
            The view without light.
        shifted : ShiftedLines
        present, level : (n,) float64
            Share of its ink at each place, and how strongly ink of its width and depth shows.
        parts : tuple of int, or None
        """
        pieces, passes, view = shifted.pieces, shifted.passes, self.view
        share = ShareOfPiece.along(self.samples, self.lines, present * level)
        if parts is None and self.prior is not None:
            fit = CrossFit(self.prior, (self.prior, self.prior))
        else:
            fit = fit_profiles(
                image, ~view.lost, passes, shifted.over, share, self.group, parts or (),
                self.prior, not self.odd, view.inkless,
                (_INDEPENDENT_WIDTHS * float(np.median(pieces.width))) ** 2,
            )  # fmt: skip
        ink = fit.whole.render(passes, shifted.over, share)

        def own_by(model: InkModel) -> FloatArray:
            return level[:, None, None] * full_ink_profile(
                model, shifted.over_across, shifted.projected
            )

        own = by_others = own_by(fit.whole)
        if self.prior is None:
            first = (self.group[:-1] == 0)[:, None, None]
            by_others = np.where(first, own_by(fit.other[0]), own_by(fit.other[1]))
        strips = (
            sample_strips(image - ink, shifted.projected, shifted.samples)
            + present[:, None, None] * own
        )
        return ViewFit(shifted, present, fit.whole, ink, own, by_others, strips)
