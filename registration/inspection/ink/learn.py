"""Learn light, the layer's shift, ink's profiles and each place's share of ink from one look.

Begin with `learned`: a coarse shift, then rounds in which profiles, shares, light and shift follow
from each other. Places that turn out bare tell nothing of ink in the next round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.ink.drawing import Drawing, Drawn, Placed
from registration.inspection.ink.ink_model import EVEN, ODD, PARTS, InkModel, ShareOfPiece, fitted
from registration.inspection.ink.judge import Judged, judge
from registration.inspection.ink.layer_shift import (
    CoarseShift,
    coarse_shift,
    finer_shift,
    with_systematics,
)
from registration.inspection.ink.passes import REACH, Passes, Pieces
from registration.inspection.options import SeeingOptions
from registration.inspection.pictures.light import EvenView
from registration.inspection.pictures.picture import View, ViewFrame
from registration.inspection.values import Appearance, ExpectedLines, FloatImage, Shift
from registration.inspection.ways import Ways

_MOVES: Final = 3
"""Rounds in which the layer moves."""
_RESTS: Final = 2
"""Rounds after them, in which profiles have all their parts; one where nothing has changed."""
_STILL: Final = 0.01
"""Widths; a layer that moves by less from one round to the next is at its place."""
_SHOWS: Final = 0.3
"""Of its level, from which on a place tells how strongly ink of its width and depth shows."""
_SLOPES: Final = (0.0, 1e-3, 1e-3)
"""Ridge on a level's slopes, with widths and with depth, mm."""


@dataclass(frozen=True)
class Learned:
    """All that was learned of a look.

    Attributes
    ----------
    even : EvenView
        The view without light.
    frame : ViewFrame
    shift : Shift
    drawn : Drawn
    judged : Judged
    odd : bool
        Whether ink shows by slopes lit from one side alone.
    """

    even: EvenView
    frame: ViewFrame
    shift: Shift
    drawn: Drawn
    judged: Judged
    odd: bool

    @property
    def view(self) -> View:
        """The picture as it is worked on."""
        return self.even.view

    @property
    def placed(self) -> Placed:
        """Lines at the layer's shift."""
        return self.drawn.placed

    def appearance(self) -> Appearance:
        """How ink looks, in the picture's own channels."""
        return Appearance(self.drawn.model.profile @ np.linalg.inv(self.even.mix).T)


def learned(
    view: View,
    frame: ViewFrame,
    lines: ExpectedLines,
    ways: Ways,
    options: SeeingOptions,
    known: Appearance | None = None,
) -> Learned:
    """Learn a look.

    Parameters
    ----------
    view : View
    frame : ViewFrame
    lines : ExpectedLines
    ways : Ways
        Places along the fresh lines, as designed.
    options : SeeingOptions
    known : Appearance or None
        How ink looked before.
    """
    if view.is_heights:  # older ink is part of the floor
        ways, lines = _fresh_alone(ways, lines)
    pieces = Pieces.of(lines, frame)
    passes = Passes.of(pieces, view.shape)
    even = EvenView.of(view, passes.near.min(axis=2))
    coarse = _coarse(even, passes, pieces, ways, lines, options)
    prior = _prior(known, even)
    look = Drawing(view, frame, lines, ways, options, prior, coarse.odd, coarse.found)
    shift = _first_shift(coarse.by_px, frame, ways)
    placed = look.placed(shift)
    present, level, rests = look.present(even.image, placed), np.ones(len(ways)), _RESTS
    parts: tuple[int, ...] = (0,) if view.is_heights else ODD if coarse.odd else EVEN
    for number in range(_MOVES):
        placed = look.placed(shift, placed)
        fit: tuple[int, ...] | None = parts
        if number == 0:  # what one line alone has of its direction could be that another is missing
            fit = None if prior is not None else parts if coarse.odd else (0,)
        drawn = look.drawn(even.image, placed, present, level, fit)
        judged = judge(look, even.image, drawn)
        before, present = present, judged.present
        full = judged.shown & (present > 0.5)
        level = _levels(level * judged.shares.share, level, full, ways)
        was = shift
        beside = full & ~placed.old if view.change is not None else full
        shift = finer_shift(was, judged.shares.offset, placed.ways, beside, options)
        if view.is_heights:
            # Of heights nothing else changes from round to round.
            moved = np.hypot(shift.dx_mm - was.dx_mm, shift.dy_mm - was.dy_mm)
            if moved < _STILL * ways.width.min() and np.abs(present - before).max() < 0.5:
                shift, rests = replace(shift, dx_mm=was.dx_mm, dy_mm=was.dy_mm), 1
                break
        even = even.less_light(drawn.ink)
    parts = (0,) if view.is_heights else tuple(range(PARTS))
    placed = look.placed(shift, placed)
    for _ in range(rests):
        drawn = look.drawn(even.image, placed, present, level, parts)
        judged = judge(look, even.image, drawn)
        present = judged.present
    shift = with_systematics(
        shift, drawn.model, coarse.odd, float(np.median(ways.width)), 1.0 / view.px_per_mm
    )
    return Learned(even, frame, shift, drawn, judged, coarse.odd)


def _fresh_alone(ways: Ways, lines: ExpectedLines) -> tuple[Ways, ExpectedLines]:
    """Places and lines without older ones."""
    row = np.cumsum(lines.fresh) - 1
    some = ExpectedLines(**{name: value[lines.fresh] for name, value in vars(lines).items()})
    return replace(ways, piece=row[ways.piece]), some


def _prior(known: Appearance | None, even: EvenView) -> InkModel | None:
    """What ink adds to the view as an earlier look tells; None where that had other channels.

    In a view of heights ink is as high as its layer, whatever is missing of it.
    """
    if even.view.is_heights:
        return InkModel.cover(float(even.mix[0, 0]))
    if known is None or known.profile.shape[3] != len(even.mix):
        return None
    return InkModel(known.profile @ even.mix.T)


def _coarse(
    even: EvenView,
    passes: Passes,
    pieces: Pieces,
    ways: Ways,
    lines: ExpectedLines,
    options: SeeingOptions,
) -> CoarseShift:
    """Where the layer lies, about: by the energy of what changed over older ink, if that is told.

    ``passes`` and ``pieces`` are at the designed place.
    """
    view = even.view
    by_energy = view.inkless > 0 and not lines.fresh.all()
    if by_energy:
        changed = even.image[:, :, view.inkless :]
        energy = np.log1p((changed**2).mean(axis=2, keepdims=True))
        shown = energy - np.float32(np.median(energy[even.ground]))
    else:
        shown = _without_older(even.image, view.lost, passes, ways, lines)
        shown = shown[:, :, view.inkless :]
    return coarse_shift(
        shown, view.lost, passes, _inner(passes, ways, lines),
        float(np.median(pieces.width[pieces.kind == 0])), options.shift_mm * view.px_per_mm,
        view.px_per_mm, view.is_heights or by_energy, by_energy,
    )  # fmt: skip


def _inner(passes: Passes, ways: Ways, lines: ExpectedLines) -> FloatImage:
    """How much each pass tells of a layer's place, (h, w, 4): ends, which recede, don't."""
    share = ShareOfPiece.along(ways, lines, np.ones(len(ways)))
    first, many = np.append(share.first, 0.0), np.append(share.many, 0.0)
    at = (first[passes.piece] + passes.part * many[passes.piece]).astype(np.int64)
    room = np.append(ways.to_end / ways.width, 0.0)[np.minimum(at, len(ways))]
    fresh = np.append(lines.fresh, False)[passes.piece]
    weight = np.clip(2.0 * room - 1.0, 0.0, 1.0)
    return np.where(fresh, weight, 0.0).astype(np.float32)


def _without_older(
    image: FloatImage, lost: BoolArray, passes: Passes, ways: Ways, lines: ExpectedLines
) -> FloatImage:
    """The view less older ink, as it shows where no fresh line is near."""
    if lines.fresh.all():
        return image
    alone = ~lost & (passes.near[:, :, 0] > REACH)
    over = np.zeros(lost.shape, dtype=np.float32)
    share = ShareOfPiece.along(ways, lines, np.zeros(len(ways)))
    model = fitted(image, alone, passes, over, share, np.full(len(ways) + 1, 2), EVEN).whole
    return image - model.drawn(passes, over, share)


def _levels(share: FloatArray, level: FloatArray, full: BoolArray, ways: Ways) -> FloatArray:
    """How strongly ink of each width and depth shows, (n,), its mean 1.

    Ink is as dark as it is thick, and the bath above veils it: the logarithm of its level is linear
    in those of its width and in its depth.
    """
    if not ways.varied or not full.any():
        return level
    terms = np.column_stack([np.log(ways.width), ways.point[:, 2]])
    terms = np.column_stack([np.ones(len(ways)), terms - terms[full].mean(axis=0)])
    use = full & (share > _SHOWS * level)
    rows = terms[use]
    power = rows.T @ rows / max(len(rows), 1) + np.diag(_SLOPES)
    score = rows.T @ np.log(share[use]) / max(len(rows), 1)
    log = terms @ np.linalg.solve(power, score)
    return np.asarray(np.exp(log - log[full].mean()))


def _first_shift(by_px: FloatArray, frame: ViewFrame, ways: Ways) -> Shift:
    """A move of the view's pixels as one on the layer's plane, however unsure."""
    middle = ways.point.mean(axis=0)
    base = frame.to_pixels(np.stack([middle, middle + (1, 0, 0), middle + (0, 1, 0)]))
    x, y = np.linalg.solve((base[1:] - base[0]).T, by_px)
    return Shift(float(x), float(y), np.full((2, 2), np.inf))
