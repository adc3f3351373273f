"""Estimate light, shift, ink profiles and shares of ink from one look.

Begin with `fit_layer`: a coarse shift, then rounds in which profiles, shares, light and shift are
estimated in turn. Places that turn out bare are left out of the next round's ink profile.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.ink.ink_model import (
    EVEN,
    ODD,
    PARTS,
    InkModel,
    ShareOfPiece,
    fit_profiles,
)
from printctl.inspection.ink.judge import InkStates, judge
from printctl.inspection.ink.layer_shift import (
    CoarseShift,
    coarse_shift,
    finer_shift,
    with_systematics,
)
from printctl.inspection.ink.passes import REACH_WIDTHS, Passes, Pieces
from printctl.inspection.ink.view_fit import ShiftedLines, ViewFit, ViewFitter
from printctl.inspection.options import SeeingOptions
from printctl.inspection.path_samples import PathSamples
from printctl.inspection.pictures.light import FlatFieldView
from printctl.inspection.pictures.picture import View, ViewFrame
from printctl.inspection.values import Appearance, ExpectedLines, FloatImage, Shift

_SHIFT_ROUNDS: Final = 3
"""Rounds in which the shift is updated."""
_FINAL_ROUNDS: Final = 2
"""Rounds after them, with all profile parts; one for heights that came to rest."""
_MAX_REST_MOVE_WIDTHS: Final = 0.01
"""Change of the shift per round, in widths, below which it has converged."""
_MIN_SHOWN_LEVEL: Final = 0.3
"""Least share of a place's level for it to count in the fit of levels."""
_LEVEL_RIDGE: Final = (0.0, 1e-3, 1e-3)
"""Ridge on a level's constant, slope with width and slope with depth (mm)."""


@dataclass(frozen=True)
class LayerFit:
    """Complete fit of one look at a layer.

    Attributes
    ----------
    flat_view : FlatFieldView
        The view without light.
    frame : ViewFrame
    shift : Shift
    view_fit : ViewFit
    ink_states : InkStates
    odd : bool
        Whether ink shows by slopes lit from one side alone.
    """

    flat_view: FlatFieldView
    frame: ViewFrame
    shift: Shift
    view_fit: ViewFit
    ink_states: InkStates
    odd: bool

    @property
    def view(self) -> View:
        """The cropped and binned picture."""
        return self.flat_view.view

    @property
    def shifted(self) -> ShiftedLines:
        """Lines at the layer's shift."""
        return self.view_fit.shifted

    def appearance(self) -> Appearance:
        """Return ink's profile in the picture's own channels."""
        return Appearance(self.view_fit.model.profile @ np.linalg.inv(self.flat_view.mix).T)


def fit_layer(
    view: View,
    frame: ViewFrame,
    lines: ExpectedLines,
    samples: PathSamples,
    options: SeeingOptions,
    known: Appearance | None = None,
) -> LayerFit:
    """Fit light, shift, ink profiles and shares of ink to a look.

    Parameters
    ----------
    view : View
    frame : ViewFrame
    lines : ExpectedLines
    samples : PathSamples
        Places along the fresh lines, as designed.
    options : SeeingOptions
    known : Appearance or None
        Ink's profile in an earlier look.
    """
    if view.is_heights:  # older ink is part of the floor
        samples, lines = _fresh_alone(samples, lines)
    pieces = Pieces.of(lines, frame)
    passes = Passes.of(pieces, view.shape)
    flat_view = FlatFieldView.of(view, passes.near.min(axis=2))
    coarse = _coarse_shift(flat_view, passes, pieces, samples, lines, options)
    prior = _prior(known, flat_view)
    fitter = ViewFitter(view, frame, lines, samples, options, prior, coarse.odd, coarse.lines_found)
    shift = _first_shift(coarse.shift_px, frame, samples)
    shifted = fitter.lines_at(shift)
    present = fitter.initial_share(flat_view.image, shifted)
    level, rests = np.ones(len(samples)), _FINAL_ROUNDS
    parts: tuple[int, ...] = (0,) if view.is_heights else ODD if coarse.odd else EVEN
    for number in range(_SHIFT_ROUNDS):
        shifted = fitter.lines_at(shift, shifted)
        fit_parts: tuple[int, ...] | None = parts
        if number == 0:  # a direction of one line only can't be distinguished from a missing line
            fit_parts = None if prior is not None else parts if coarse.odd else (0,)
        view_fit = fitter.fit(flat_view.image, shifted, present, level, fit_parts)
        ink_states = judge(fitter, flat_view.image, view_fit)
        before, present = present, ink_states.present
        full = ink_states.shown & (present > 0.5)
        level = _fit_levels(level * ink_states.shares.share, level, full, samples)
        was = shift
        beside = full & ~shifted.old if view.change is not None else full
        shift = finer_shift(was, ink_states.shares.offset, shifted.samples, beside, options)
        if view.is_heights:
            # Of heights nothing else changes from round to round.
            moved = np.hypot(shift.dx_mm - was.dx_mm, shift.dy_mm - was.dy_mm)
            if (
                moved < _MAX_REST_MOVE_WIDTHS * samples.width.min()
                and np.abs(present - before).max() < 0.5
            ):
                shift, rests = replace(shift, dx_mm=was.dx_mm, dy_mm=was.dy_mm), 1
                break
        flat_view = flat_view.without_light(view_fit.ink)
    parts = (0,) if view.is_heights else tuple(range(PARTS))
    shifted = fitter.lines_at(shift, shifted)
    for _ in range(rests):
        view_fit = fitter.fit(flat_view.image, shifted, present, level, parts)
        ink_states = judge(fitter, flat_view.image, view_fit)
        present = ink_states.present
    shift = with_systematics(
        shift, view_fit.model, coarse.odd, float(np.median(samples.width)), 1.0 / view.px_per_mm
    )
    return LayerFit(flat_view, frame, shift, view_fit, ink_states, coarse.odd)


def _fresh_alone(samples: PathSamples, lines: ExpectedLines) -> tuple[PathSamples, ExpectedLines]:
    """Return sample points and lines without older lines."""
    row = np.cumsum(lines.fresh) - 1
    some = ExpectedLines(**{name: value[lines.fresh] for name, value in vars(lines).items()})
    return replace(samples, piece=row[samples.piece]), some


def _prior(known: Appearance | None, flat_view: FlatFieldView) -> InkModel | None:
    """Return the ink model known from an earlier look; None where its channels differ.

    In a view of heights ink is as high as its layer, whatever is missing of it.
    """
    if flat_view.view.is_heights:
        return InkModel.cover(float(flat_view.mix[0, 0]))
    if known is None or known.profile.shape[3] != len(flat_view.mix):
        return None
    return InkModel(known.profile @ flat_view.mix.T)


def _coarse_shift(
    flat_view: FlatFieldView,
    passes: Passes,
    pieces: Pieces,
    samples: PathSamples,
    lines: ExpectedLines,
    options: SeeingOptions,
) -> CoarseShift:
    """Return the coarse shift: by the energy of change over older ink, if a picture before exists.

    ``passes`` and ``pieces`` are at the designed place.
    """
    view = flat_view.view
    by_energy = view.inkless > 0 and not lines.fresh.all()
    if by_energy:
        changed = flat_view.image[:, :, view.inkless :]
        energy = np.log1p((changed**2).mean(axis=2, keepdims=True))
        shown = energy - np.float32(np.median(energy[flat_view.ground]))
    else:
        shown = _without_older(flat_view.image, view.lost, passes, samples, lines)
        shown = shown[:, :, view.inkless :]
    return coarse_shift(
        shown, view.lost, passes, _pass_weights(passes, samples, lines),
        float(np.median(pieces.width[pieces.kind == 0])), options.shift_mm * view.px_per_mm,
        view.px_per_mm, view.is_heights or by_energy, by_energy,
    )  # fmt: skip


def _pass_weights(passes: Passes, samples: PathSamples, lines: ExpectedLines) -> FloatImage:
    """Return each pass's weight in the shift, (h, w, 4): 0 at line ends, which recede."""
    share = ShareOfPiece.along(samples, lines, np.ones(len(samples)))
    first, sample_count = np.append(share.first, 0.0), np.append(share.sample_count, 0.0)
    at = (first[passes.piece] + passes.part * sample_count[passes.piece]).astype(np.int64)
    end_distance = np.append(samples.to_end / samples.width, 0.0)[np.minimum(at, len(samples))]
    fresh = np.append(lines.fresh, False)[passes.piece]
    weight = np.clip(2.0 * end_distance - 1.0, 0.0, 1.0)
    return np.where(fresh, weight, 0.0).astype(np.float32)


def _without_older(
    image: FloatImage, lost: BoolArray, passes: Passes, samples: PathSamples, lines: ExpectedLines
) -> FloatImage:
    """Subtract older ink, fitted where no fresh line is near, from the view."""
    if lines.fresh.all():
        return image
    alone = ~lost & (passes.near[:, :, 0] > REACH_WIDTHS)
    over = np.zeros(lost.shape, dtype=np.float32)
    share = ShareOfPiece.along(samples, lines, np.zeros(len(samples)))
    model = fit_profiles(
        image, alone, passes, over, share, np.full(len(samples) + 1, 2), EVEN
    ).whole
    return image - model.render(passes, over, share)


def _fit_levels(
    share: FloatArray, level: FloatArray, full: BoolArray, samples: PathSamples
) -> FloatArray:
    """Fit the relative level of ink of each width and depth, (n,), its mean 1.

    Ink's darkness grows with its thickness, and the bath above veils it: the logarithm of its level
    is linear in those of its width and in its depth.
    """
    if not samples.varied or not full.any():
        return level
    terms = np.column_stack([np.log(samples.width), samples.point[:, 2]])
    terms = np.column_stack([np.ones(len(samples)), terms - terms[full].mean(axis=0)])
    use = full & (share > _MIN_SHOWN_LEVEL * level)
    rows = terms[use]
    power = rows.T @ rows / max(len(rows), 1) + np.diag(_LEVEL_RIDGE)
    score = rows.T @ np.log(share[use]) / max(len(rows), 1)
    log = terms @ np.linalg.solve(power, score)
    return np.asarray(np.exp(log - log[full].mean()))


def _first_shift(shift_px: FloatArray, frame: ViewFrame, samples: PathSamples) -> Shift:
    """Convert a shift in the view's pixels to the layer's plane, its covariance infinite."""
    middle = samples.point.mean(axis=0)
    base = frame.to_pixels(np.stack([middle, middle + (1, 0, 0), middle + (0, 1, 0)]))
    x, y = np.linalg.solve((base[1:] - base[0]).T, shift_px)
    return Shift(float(x), float(y), np.full((2, 2), np.inf))
