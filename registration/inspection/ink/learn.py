"""Learn light, the layer's shift, ink's profiles and each place's share of ink from one look.

Begin with `learned`: a coarse shift, then rounds in which profiles, shares, light and shift follow
from each other. Places that turn out bare tell nothing of ink in the next round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.chain import BARE, HIDDEN, THIN, posterior
from registration.inspection.ink.change import change_of
from registration.inspection.ink.ink_model import (
    EVEN,
    ODD,
    PARTS,
    CrossFit,
    InkModel,
    ShareOfPiece,
    fitted,
)
from registration.inspection.ink.layer_shift import coarse_shift, finer_shift
from registration.inspection.ink.noise import BareStrips, Noise, noise_of
from registration.inspection.ink.passes import REACH, Passes, Pieces
from registration.inspection.ink.shares import (
    ACROSS,
    Shares,
    StripNoise,
    beside_line,
    measured,
    own_profile,
    strips_of,
)
from registration.inspection.options import SeeingOptions
from registration.inspection.pictures.ground import light_of, telling_pixels
from registration.inspection.pictures.picture import View, ViewFrame
from registration.inspection.values import Appearance, ExpectedLines, FloatImage, Shift
from registration.inspection.ways import Seen, Ways

_ROUNDS: Final = 5
_LAST_MOVE: Final = 2
"""Rounds at the end in which the shift rests, and profiles have all their parts."""
_STILL: Final = 0.01
"""Widths; a layer that moves by less from one round to the next is at its place."""
_OVER: Final = (0.65, 0.35)
"""Widths from the middle of older ink at which there is none of it, and all."""
_OLD: Final = 0.05
"""Of a place's width over older ink: more, and it is judged against that."""
_UNSEEN: Final = 0.7
"""Of a strip's inner part that may be lost; what is left tells the less."""
_WHOLE: Final = 0.2
"""The same of strips by which ink's noise is learned; of a view that lost more, the better half."""
_ENDS: Final = 0.5
"""Widths from a line's end, within which it isn't judged by itself: ink recedes or bulges there."""
_ROUGH: Final = 0.05
"""Scatter of heights on the ground, thicknesses of the layer."""
_CELL: Final = 0.4
"""Of a width: pixels nearer to each other tell the same."""
_FAINTEST: Final = 0.05
_INK_TELLS: Final = 0.3
"""How much ink tells of light, against ground."""
_FEWEST: Final = 100
_PIECE: Final = 2.0
"""Widths along a line that are judged by a profile that others tell."""
_FEWEST_PIECES: Final = 4
"""Of a layer: those of a short one are shorter."""
_TOLD: Final = 3.5
"""Standard errors of the mean share from which on a profile is more than noise: without ink it
stayed below 2.5 in pictures of older ink alone."""
_KNOWN: Final = (0.5, 2.0)
"""Of the level that ink had in an earlier look in the same light."""
_SHOWS: Final = 0.3
"""Of its level, from which on a place tells how strongly ink of its width and depth shows."""
_SLOPES: Final = (0.0, 1e-3, 1e-3)
"""Ridge on a level's slopes, with widths and with depth, mm."""


@dataclass(frozen=True)
class Drawn:
    """A view and its model at one shift.

    Attributes
    ----------
    ways : Ways
        Moved by the shift.
    seen : Seen
    pieces : Pieces
    passes : Passes
    over : (h, w) float32
        How much older ink lies at each pixel, 0 to 1.
    old : (n,) bool
        Places over older ink.
    model : InkModel
    drawn : (h, w, c) float32
        What the model draws.
    own : (n, u, c) float64
        What full ink of its own adds across each place.
    judged : (n, u, c) float64
        The same by a profile to which the place itself was not fitted, unless one is known.
    strips : (n, u, c) float64
        The view across each place, without everything else.
    """

    ways: Ways
    seen: Seen
    pieces: Pieces
    passes: Passes
    over: FloatImage
    old: BoolArray
    model: InkModel
    drawn: FloatImage
    own: FloatArray
    judged: FloatArray
    strips: FloatArray

    @property
    def looks_full(self) -> BoolArray:
        """Strips that are nearer to all of their ink than to none, (n,)."""
        return np.asarray(((self.strips - 0.5 * self.own) * self.own).sum(axis=(1, 2)) > 0.0)

    @cached_property
    def crossed(self) -> BoolArray:
        """Places over or under which the view shows another of the layer's lines, (n,)."""
        return self.ways.crossed_in(self.seen)


@dataclass(frozen=True)
class Learned:
    """All that was learned of a look.

    Attributes
    ----------
    view : View
    frame : ViewFrame
    image : (h, w, c) float32
        Without light; the ground is 0, its noise 1.
    mix : (c, c) float64
        What channels were multiplied by for that.
    shift : Shift
    drawn : Drawn
    shown : (n,) bool
        Places that the picture shows.
    shares : Shares
    noise : Noise
    misfit : (n,) float64
        Its logarithm.
    states : (n, 4) float64
        Probabilities of full, thin, bare and hidden.
    inverse : (u c, u c) float64
        Inverse covariance of what strips hold beside their lines' own share and width: by it
        widths, and amounts of ink where lines touch, are compared along lines.
    odd : bool
        Whether ink shows by slopes lit from one side alone.
    lost : (n, u) bool
        Samples of strips that the picture doesn't show.
    """

    view: View
    frame: ViewFrame
    image: FloatImage
    mix: FloatArray
    shift: Shift
    drawn: Drawn
    shown: BoolArray
    shares: Shares
    noise: Noise
    misfit: FloatArray
    states: FloatArray
    inverse: FloatArray
    odd: bool
    lost: BoolArray

    @property
    def hidden(self) -> BoolArray:
        """Places of whose inner strip the picture shows too little, (n,)."""
        return np.asarray(_lost_part(self.lost) >= _UNSEEN)

    def appearance(self) -> Appearance:
        """How ink looks, in the picture's own channels."""
        return Appearance(self.drawn.model.profile @ np.linalg.inv(self.mix).T)


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
    channels = view.channels
    if view.is_heights:  # older ink is part of the floor
        ways, lines = _fresh_alone(ways, lines)
    pieces = Pieces.of(lines, frame)
    passes = Passes.of(pieces, view.shape)
    ground = telling_pixels(view.lost, passes.near.min(axis=2))
    if view.is_heights:
        light = np.zeros_like(channels)
        mix = np.eye(1) / _ROUGH
    else:
        light = light_of(channels, ground, view.px_per_mm)
        mix = _whitening((channels - light)[ground > 0], channels - light, view.inkless)
    image = _mixed(channels - light, mix)
    shown = _without_older(image, view.lost, passes, pieces, ways, lines)[:, :, view.inkless :]
    by_energy = view.inkless > 0 and not lines.fresh.all()
    if by_energy:
        energy = np.log1p((image[:, :, view.inkless :] ** 2).mean(axis=2, keepdims=True))
        shown = energy - np.float32(np.median(energy[ground > 0]))
    coarse = coarse_shift(
        shown, view.lost, passes,
        _inner(passes, ways, lines), float(np.median(pieces.width[pieces.kind == 0])),
        options.shift_mm * view.px_per_mm, view.px_per_mm, view.is_heights or by_energy,
    )  # fmt: skip
    shift = _first_shift(coarse.by_px, frame, ways)
    state, level = np.ones(len(ways)), np.ones(len(ways))
    group = _two_groups(ways)
    prior = None if known is None else _of_picture(known, mix)
    if view.is_heights:  # ink is as high as its layer, whatever is missing of it
        prior = InkModel.cover(1.0 / _ROUGH)
    if prior is not None:
        state = _first_state(prior, image, view, frame, ways, shift, options)
    settled, so_far = False, None
    for number in range(_ROUNDS):
        if settled and number < _ROUNDS - 1:
            continue
        last = number >= _ROUNDS - _LAST_MOVE
        parts = tuple(range(PARTS)) if last else (ODD if coarse.odd else EVEN)
        parts = (0,) if view.is_heights else parts
        drawn = _draw(
            view,
            frame,
            image,
            lines,
            ways,
            shift,
            state,
            level,
            group,
            parts,
            options,
            prior,
            number == 0,
            not coarse.odd,
            so_far,
        )
        so_far = drawn
        lost = _lost_samples(view, drawn)
        shown, shares, noise, misfit, states, inverse = _judge(
            view, image, drawn, state, lost, prior is not None
        )
        before, state = state, _presence(states, shares.share)
        if not last:
            level = _levels(level * shares.share, level, shown & (state > 0.5), ways)
        if not last:
            place, sure = shift, shown & (state > 0.5)
            shift = finer_shift(shift, shares.offset, drawn.ways, sure, options, coarse.odd)
            moved = np.hypot(shift.dx_mm - place.dx_mm, shift.dy_mm - place.dy_mm)
            changed = np.abs(state - before).max()
            # Of heights nothing else changes from round to round.
            settled = view.is_heights and moved < _STILL * ways.width.min() and changed < 0.5
            if settled:
                shift = replace(shift, dx_mm=place.dx_mm, dy_mm=place.dy_mm)
        if not view.is_heights and not last:
            light = light + _light_left(view, image, drawn, ground, mix)
            image = _mixed(channels - light, mix)
    return Learned(
        view,
        frame,
        image,
        mix,
        shift,
        drawn,
        shown,
        shares,
        noise,
        misfit,
        states,
        inverse,
        coarse.odd,
        lost,
    )


def _fresh_alone(ways: Ways, lines: ExpectedLines) -> tuple[Ways, ExpectedLines]:
    """Places and lines without older ones."""
    row = np.cumsum(lines.fresh) - 1
    some = ExpectedLines(**{name: value[lines.fresh] for name, value in vars(lines).items()})
    return replace(ways, piece=row[ways.piece]), some


def _first_state(
    prior: InkModel,
    image: FloatImage,
    view: View,
    frame: ViewFrame,
    ways: Ways,
    shift: Shift,
    options: SeeingOptions,
) -> FloatArray:
    """Which places have ink, (n,), by the level in their middle where a profile is known.

    Of lines that touch and are bare together each looks full beside others that are drawn.
    """
    there = ways.moved(np.array([shift.dx_mm, shift.dy_mm]))
    seen = Seen.of(there, frame, options.round_lines)
    core = np.abs(ACROSS) <= _OVER[1]
    shown = strips_of((~view.lost)[:, :, None].astype(np.float32), seen, there)[:, core]
    own = own_profile(prior, np.zeros((len(ways), len(ACROSS))), seen)[:, core] * shown
    power = (own**2).sum(axis=(1, 2))
    share = (strips_of(image, seen, there)[:, core] * own).sum(axis=(1, 2))
    return np.asarray((share > 0.5 * power) | (power <= 0.0), dtype=np.float64)


def _inner(passes: Passes, ways: Ways, lines: ExpectedLines) -> FloatImage:
    """How much each pass tells of a layer's place, (h, w, 4): ends, which recede, don't."""
    share = ShareOfPiece.along(ways, lines, np.ones(len(ways)))
    first, many = np.append(share.first, 0.0), np.append(share.many, 0.0)
    at = (first[passes.piece] + passes.part * many[passes.piece]).astype(np.int64)
    room = np.append(ways.to_end / ways.width, 0.0)[np.minimum(at, len(ways))]
    fresh = np.append(lines.fresh, False)[passes.piece]
    weight = np.clip(2.0 * room - 1.0, 0.0, 1.0)
    return np.where(fresh, weight, 0.0).astype(np.float32)


def _draw(
    view: View,
    frame: ViewFrame,
    image: FloatImage,
    lines: ExpectedLines,
    ways: Ways,
    shift: Shift,
    state: FloatArray,
    level: FloatArray,
    group: IntArray,
    parts: tuple[int, ...],
    options: SeeingOptions,
    prior: InkModel | None,
    first: bool,
    plain: bool,
    last: Drawn | None,
) -> Drawn:
    """Fit profiles at a shift (``first`` with what is known of them), and take strips.

    Of the ``last`` round's places and passes, those at the same shift are taken as they are.
    """
    by = np.array([shift.dx_mm, shift.dy_mm])
    there = ways.moved(by)
    if last is not None and np.array_equal(there.point, last.ways.point):
        there, pieces, passes, seen = last.ways, last.pieces, last.passes, last.seen
    else:
        off = np.where(lines.fresh[:, None], np.append(by, 0.0), 0.0)
        moved = replace(lines, start=lines.start + off, end=lines.end + off)
        pieces = Pieces.of(moved, frame)
        passes, seen = Passes.of(pieces, view.shape), Seen.of(there, frame, options.round_lines)
    older = passes.near[:, :, 1]
    over = np.clip((_OVER[0] - older) / (_OVER[0] - _OVER[1]), 0.0, 1.0).astype(np.float32)
    share = ShareOfPiece.along(ways, lines, state * level)
    if prior is None or not first:
        fit = fitted(
            image, ~view.lost, passes, over, pieces.kind, share, group, parts, prior, plain,
            view.inkless, (_CELL * float(np.median(pieces.width))) ** 2,
        )  # fmt: skip
    else:
        fit = CrossFit(prior, (prior, prior))
    model = fit.whole
    drawn = model.drawn(passes, over, pieces.kind, share)
    over_at = strips_of(over[:, :, None], seen, there)[:, :, 0]
    own = level[:, None, None] * own_profile(model, over_at, seen)
    judged = own
    if prior is None:
        others = (level[:, None, None] * own_profile(each, over_at, seen) for each in fit.other)
        judged = np.where((group[:-1] == 0)[:, None, None], *others)
    strips = strips_of(image - drawn, seen, there) + state[:, None, None] * own
    old = over_at[:, np.abs(ACROSS) <= 0.5].mean(axis=1) > _OLD
    return Drawn(there, seen, pieces, passes, over, old, model, drawn, own, judged, strips)


def _lost_samples(view: View, drawn: Drawn) -> BoolArray:
    lost = view.lost[:, :, None].astype(np.float32)
    return np.asarray(strips_of(lost, drawn.seen, drawn.ways)[:, :, 0] > 0.1)


def _lost_part(lost: BoolArray) -> FloatArray:
    return np.asarray(lost[:, np.abs(ACROSS) < 0.6].mean(axis=1))


def _judge(
    view: View, image: FloatImage, drawn: Drawn, state: FloatArray, lost: BoolArray, is_known: bool
) -> tuple[BoolArray, Shares, Noise, FloatArray, FloatArray, FloatArray]:
    """Measure shares, learn how they scatter, and tell states."""
    ways, count = drawn.ways, len(drawn.ways)
    part = _lost_part(lost)
    told = drawn.seen.inside(view.shape, 0.6 * ways.width) & (part < _UNSEEN)
    told &= ~drawn.crossed & (ways.to_end > _ENDS * ways.width)
    whole = told & (part <= max(_WHOLE, float(np.median(part[told])) if told.any() else 0.0))
    shares = Shares(*np.zeros((5, count)))
    spreads, misfits, tie = np.ones((2, count)), np.zeros((2, count, 2)), 0.5
    flat = drawn.strips.reshape(count, -1)
    rest = flat - state[:, None] * drawn.own.reshape(count, -1)
    inverse: FloatArray = np.eye(flat.shape[1])
    by_change = drawn.old & (view.change is not None)
    if not view.is_heights:
        told &= ~drawn.old | by_change
    for rows, over in ((~drawn.old, None), (drawn.old, drawn.over)):
        if not rows.any():
            continue
        good = whole & rows & (state > 0.5) & drawn.looks_full
        own_rows = np.flatnonzero(rows)
        bare = BareStrips.laid(
            image - drawn.drawn, drawn.passes, drawn.pieces.kind, view.lost, drawn.seen, ways,
            own_rows, over,
        )  # fmt: skip
        without = bare.strips if len(bare.strips) else flat[told & rows & ~drawn.looks_full]
        doubt = drawn.model.doubt_across(0 if over is None else 1, ACROSS)
        strip_noise = StripNoise.of(rest[good], without, drawn.own[rows], doubt)
        if over is None or drawn.old.all():
            left = beside_line(rest[good], drawn.own[good])
            inverse = StripNoise.of(left, without, drawn.own[rows], doubt).inverse
        found = measured(drawn.strips[rows], drawn.own[rows], strip_noise, lost[rows])
        if not is_known and not _is_told(drawn, strip_noise, told & rows):
            told = told & ~rows
        top = _full_level(found.share[told[rows]], _FAINTEST)
        if is_known:
            top = min(max(top, _KNOWN[0]), _KNOWN[1])
        own = drawn.own * top
        found = replace(found, share=found.share / top, u_share=found.u_share / top)
        for name in ("share", "u_share", "offset", "wider", "misfit"):
            getattr(shares, name)[rows] = getattr(found, name)
        log = np.log(np.maximum(shares.misfit, 1e-9))
        # Slopes that light grazes along a line show little of it there.
        usual = float(np.median(shares.u_share[good if good.any() else rows]))
        dim = np.maximum(1.0, shares.u_share / max(usual, 1e-9))
        each, tie, both = noise_of(
            1.0 + (shares.share - 1.0) / dim, usual, log, good, ways.run, bare, own, strip_noise
        )
        spreads[:, rows], misfits[:, rows] = each[:, None] * dim[rows], both[:, None]
    misfit = np.log(np.maximum(shares.misfit, 1e-9))
    shaded = np.ones(2)
    if by_change.any():
        told, shaded = _by_change(
            view, image, drawn, state, lost, told, by_change, shares, spreads, misfit, misfits
        )
    shaded = np.where(by_change[:, None], shaded, np.column_stack([np.zeros(count), spreads[1]]))
    noise = Noise(spreads[0], spreads[1], tie, misfits[0], misfits[1], shaded)
    known = np.where(told, shares.share, np.nan)
    states = posterior(known, misfit, noise, ways.run, ways.step)
    return told, shares, noise, misfit, states, inverse


def _by_change(
    view: View,
    image: FloatImage,
    drawn: Drawn,
    state: FloatArray,
    lost: BoolArray,
    told: BoolArray,
    rows: BoolArray,
    shares: Shares,
    spreads: FloatArray,
    misfit: FloatArray,
    misfits: FloatArray,
) -> tuple[BoolArray, FloatArray]:
    ways = drawn.ways
    changed = np.ascontiguousarray(image[:, :, view.inkless :])
    bare, beside = (
        BareStrips.laid(
            changed, drawn.passes, drawn.pieces.kind, view.lost, drawn.seen, ways,
            np.arange(len(ways)), None, near,
        ).strips
        for near in (False, True)
    )  # fmt: skip
    strips = strips_of(changed, drawn.seen, ways)
    found = change_of(
        strips[rows],
        drawn.own[rows][:, :, view.inkless :],
        lost[rows],
        bare,
        beside,
        (told & (state > 0.5))[rows],
        ways.run[rows],
    )
    if found is None:
        return told & ~rows, np.ones(2)
    shares.share[rows] = found.share
    spreads[:, rows] = np.array([found.full, found.bare])[:, None]
    misfit[rows] = found.misfit
    misfits[0, rows], misfits[1, rows] = found.misfit_full, found.misfit_bare
    return told, np.array(found.shaded)


def _two_groups(ways: Ways) -> IntArray:
    """Part places into pieces some widths long, by turns of group 0 and 1; a 2 at the end."""
    at = ways.along / ways.width
    piece = min(_PIECE, float((ways.step / ways.width).sum()) / _FEWEST_PIECES)
    group = (at / piece).astype(np.int64) + ways.stroke
    return np.append(group % 2, 2)


def _is_told(drawn: Drawn, noise: StripNoise, rows: BoolArray) -> bool:
    """Whether ink of some places shows by the profile that others tell; else a profile is noise."""
    if not rows.any():
        return False
    found = measured(drawn.strips[rows], drawn.judged[rows], noise)
    independent = float((drawn.ways.step / drawn.ways.width)[rows].sum())
    spread = float(np.sqrt((found.u_share**2).mean()) / np.sqrt(max(independent, 1.0)))
    return float(found.share.mean()) > _TOLD * spread


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


def _presence(states: FloatArray, share: FloatArray) -> FloatArray:
    """How much ink is drawn at each place in the next round."""
    known = states[:, :HIDDEN].sum(axis=1)
    there = np.where(known > 0.1, 1.0 - states[:, BARE] / np.maximum(known, 1e-9), 1.0)
    thin = states[:, THIN] > 0.5
    return np.asarray(np.where(thin, np.clip(share, 0.2, 1.0), there))


def _full_level(share: FloatArray, least: float) -> float:
    """Usual share of lines that have ink, of which some may be missing; 1 for too little."""
    if len(share) < 4:
        return 1.0
    level = float(np.percentile(share, 80))
    for _ in range(4):
        upper = share[share > 0.5 * level]
        level = float(np.median(upper)) if len(upper) else level
    return level if level > least else 1.0


def _light_left(
    view: View, image: FloatImage, drawn: Drawn, ground: FloatImage, mix: FloatArray
) -> FloatImage:
    """Light that the model leaves unexplained, (h, w, c)."""
    rest = _mixed(image - drawn.drawn, np.linalg.inv(mix).astype(np.float64))
    weight = np.where(view.lost, 0.0, np.where(ground > 0, 1.0, _INK_TELLS)).astype(np.float32)
    return light_of(rest, weight, view.px_per_mm)


def _without_older(
    image: FloatImage,
    lost: BoolArray,
    passes: Passes,
    pieces: Pieces,
    ways: Ways,
    lines: ExpectedLines,
) -> FloatImage:
    """The view less older ink, as it shows where no fresh line is near."""
    if not (pieces.kind == 1).any():
        return image
    alone = ~lost & (passes.near[:, :, 0] > REACH)
    over = np.zeros(lost.shape, dtype=np.float32)
    share = ShareOfPiece.along(ways, lines, np.zeros(len(ways)))
    group = np.full(len(ways) + 1, 2)
    model = fitted(image, alone, passes, over, pieces.kind, share, group, EVEN).whole
    return image - model.drawn(passes, over, pieces.kind, share)


def _whitening(ground: FloatImage, everything: FloatImage, inkless: int) -> FloatArray:
    """Matrix (c, c) that makes noise of the ground 1 in each channel and independent.

    What was taken before, the first channels, isn't mixed with what changed: older ink mustn't
    show there.
    """
    count = everything.shape[2]
    own = ground if len(ground) >= _FEWEST else everything.reshape(-1, count)
    low, high = np.percentile(own, [1, 99], axis=0)
    inner = own[((own >= low) & (own <= high)).all(axis=1)]
    cov = np.cov(inner.T).reshape(count, count)
    mix = np.zeros((count, count))
    for part in (slice(0, inkless), slice(inkless, count)):
        block = cov[part, part]
        block = block + (1e-3 * np.trace(block) / max(len(block), 1) + 1e-8) * np.eye(len(block))
        mix[part, part] = np.linalg.inv(np.linalg.cholesky(block))
    return mix


def _mixed(values: FloatImage, mix: FloatArray) -> FloatImage:
    return np.ascontiguousarray(values @ mix.T.astype(np.float32), dtype=np.float32)


def _of_picture(known: Appearance, mix: FloatArray) -> InkModel | None:
    """What ink would add to the whitened view; None where it had other channels."""
    if known.profile.shape[3] != len(mix):
        return None
    return InkModel(known.profile @ mix.T)


def _first_shift(by_px: FloatArray, frame: ViewFrame, ways: Ways) -> Shift:
    """A move of the view's pixels as one on the layer's plane, however unsure."""
    middle = ways.point.mean(axis=0)
    base = frame.to_pixels(np.stack([middle, middle + (1, 0, 0), middle + (0, 1, 0)]))
    x, y = np.linalg.solve((base[1:] - base[0]).T, by_px)
    return Shift(float(x), float(y), np.full((2, 2), np.inf))
