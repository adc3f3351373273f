"""Fit ink's profiles to a view at a shift, draw the view by them, and take strips across places."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_model import CrossFit, InkModel, ShareOfPiece, fitted
from registration.inspection.ink.passes import Passes, Pieces
from registration.inspection.ink.shares import ACROSS, own_profile, strips_of
from registration.inspection.options import SeeingOptions
from registration.inspection.pictures.picture import View, ViewFrame
from registration.inspection.values import ExpectedLines, FloatImage, Shift
from registration.inspection.ways import Seen, Ways

_OVER: Final = (0.65, 0.35)
"""Widths from the middle of older ink at which there is none of it, and all."""
_OLD: Final = 0.05
"""Of a place's width over older ink: more, and it is judged against that."""
_CELL: Final = 0.4
"""Of a width: pixels nearer to each other tell the same."""
_PIECE: Final = 2.0
"""Widths along a line that are judged by a profile that others tell."""
_FEWEST_PIECES: Final = 4
"""Of a layer: those of a short one are shorter."""


@dataclass(frozen=True)
class Placed:
    """Lines and places at one shift.

    Attributes
    ----------
    ways : Ways
        Moved by the shift.
    seen : Seen
    pieces : Pieces
    passes : Passes
    """

    ways: Ways
    seen: Seen
    pieces: Pieces
    passes: Passes

    @cached_property
    def over(self) -> FloatImage:
        """How much older ink lies at each pixel, 0 to 1, (h, w)."""
        older = self.passes.near[:, :, 1]
        over = np.clip((_OVER[0] - older) / (_OVER[0] - _OVER[1]), 0.0, 1.0)
        return np.asarray(over, dtype=np.float32)

    @cached_property
    def over_across(self) -> FloatArray:
        """The same across each place, (n, u)."""
        return strips_of(self.over[:, :, None], self.seen, self.ways)[:, :, 0]

    @cached_property
    def old(self) -> BoolArray:
        """Places over older ink, (n,)."""
        return np.asarray(self.over_across[:, np.abs(ACROSS) <= 0.5].mean(axis=1) > _OLD)

    @cached_property
    def crossed(self) -> BoolArray:
        """Places over or under which the view shows another of the layer's lines, (n,)."""
        return self.ways.crossed_in(self.seen)


@dataclass(frozen=True)
class Drawn:
    """A view's model at one shift.

    Attributes
    ----------
    placed : Placed
    present : (n,) float64
        Share of its ink that each place was drawn with.
    model : InkModel
    ink : (h, w, c) float32
        What the model draws.
    own : (n, u, c) float64
        What full ink of its own adds across each place.
    by_others : (n, u, c) float64
        The same by a profile to which the place itself was not fitted, unless one is known.
    strips : (n, u, c) float64
        The view across each place, without everything else.
    """

    placed: Placed
    present: FloatArray
    model: InkModel
    ink: FloatImage
    own: FloatArray
    by_others: FloatArray
    strips: FloatArray

    @cached_property
    def rest(self) -> FloatArray:
        """What the model leaves of strips, (n, u, c)."""
        return self.strips - self.present[:, None, None] * self.own

    @cached_property
    def looks_full(self) -> BoolArray:
        """Strips that are nearer to all of their ink than to none, (n,)."""
        return np.asarray(((self.strips - 0.5 * self.own) * self.own).sum(axis=(1, 2)) > 0.0)


@dataclass(frozen=True)
class Drawing:
    """What a look is drawn by, the same in all rounds.

    Attributes
    ----------
    view : View
    frame : ViewFrame
    lines : ExpectedLines
    ways : Ways
        Places along the fresh lines, as designed.
    options : SeeingOptions
    prior : InkModel or None
        Profiles known beforehand.
    odd : bool
        Whether ink shows by slopes lit from one side alone.
    found : bool
        Whether lines explain the view better at their place than beside it.
    """

    view: View
    frame: ViewFrame
    lines: ExpectedLines
    ways: Ways
    options: SeeingOptions
    prior: InkModel | None
    odd: bool
    found: bool

    @cached_property
    def group(self) -> IntArray:
        """Pieces of places some widths long, by turns of group 0 and 1, (n + 1,); 2 at the end."""
        at = self.ways.along / self.ways.width
        length = float((self.ways.step / self.ways.width).sum())
        piece = min(_PIECE, length / _FEWEST_PIECES)
        return np.append(((at / piece).astype(np.int64) + self.ways.stroke) % 2, 2)

    def placed(self, shift: Shift, last: Placed | None = None) -> Placed:
        """Return lines at a shift: those of the ``last`` round where they haven't moved."""
        by = np.array([shift.dx_mm, shift.dy_mm])
        there = self.ways.moved(by)
        if last is not None and np.array_equal(there.point, last.ways.point):
            return last
        off = np.where(self.lines.fresh[:, None], np.append(by, 0.0), 0.0)
        moved = replace(self.lines, start=self.lines.start + off, end=self.lines.end + off)
        pieces = Pieces.of(moved, self.frame)
        seen = Seen.of(there, self.frame, self.options.round_lines)
        return Placed(there, seen, pieces, Passes.of(pieces, self.view.shape))

    def present(self, image: FloatImage, placed: Placed) -> FloatArray:
        """Which places have ink, (n,), by the level in their middle where a profile is known.

        Of lines that touch and are bare together each looks full beside others that are drawn.
        """
        if self.prior is None:
            return np.ones(len(self.ways))
        ways, seen, core = placed.ways, placed.seen, np.abs(ACROSS) <= _OVER[1]
        shown = strips_of((~self.view.lost)[:, :, None].astype(np.float32), seen, ways)[:, core]
        nothing_below = np.zeros((len(ways), len(ACROSS)))
        own = own_profile(self.prior, nothing_below, seen)[:, core] * shown
        power = (own**2).sum(axis=(1, 2))
        share = (strips_of(image, seen, ways)[:, core] * own).sum(axis=(1, 2))
        return np.asarray((share > 0.5 * power) | (power <= 0.0), dtype=np.float64)

    def drawn(
        self,
        image: FloatImage,
        placed: Placed,
        present: FloatArray,
        level: FloatArray,
        parts: tuple[int, ...] | None,
    ) -> Drawn:
        """Fit profiles of these parts, or take those that are known (None), and draw by them.

        Parameters
        ----------
        image : (h, w, c) float32
            The view without light.
        placed : Placed
        present, level : (n,) float64
            Share of its ink at each place, and how strongly ink of its width and depth shows.
        parts : tuple of int, or None
        """
        pieces, passes, view = placed.pieces, placed.passes, self.view
        share = ShareOfPiece.along(self.ways, self.lines, present * level)
        if parts is None and self.prior is not None:
            fit = CrossFit(self.prior, (self.prior, self.prior))
        else:
            fit = fitted(
                image, ~view.lost, passes, placed.over, share, self.group, parts or (),
                self.prior, not self.odd, view.inkless,
                (_CELL * float(np.median(pieces.width))) ** 2,
            )  # fmt: skip
        ink = fit.whole.drawn(passes, placed.over, share)

        def own_by(model: InkModel) -> FloatArray:
            return level[:, None, None] * own_profile(model, placed.over_across, placed.seen)

        own = by_others = own_by(fit.whole)
        if self.prior is None:
            first = (self.group[:-1] == 0)[:, None, None]
            by_others = np.where(first, own_by(fit.other[0]), own_by(fit.other[1]))
        strips = strips_of(image - ink, placed.seen, placed.ways) + present[:, None, None] * own
        return Drawn(placed, present, fit.whole, ink, own, by_others, strips)
