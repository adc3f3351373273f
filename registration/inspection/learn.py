"""Learn light, the layer's shift, ink's profiles and each place's share of ink from one look.

Begin with `learned`: a coarse shift, then rounds in which profiles, shares, light and shift follow
from each other. Places that turn out bare tell nothing of ink in the next round.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.inspection.chain import BARE, HIDDEN, THIN, posterior
from registration.inspection.ground import light_of, telling_pixels
from registration.inspection.ink_model import (
    EVEN,
    NODES,
    ODD,
    PARTS,
    InkModel,
    ShareOfPiece,
    fitted,
)
from registration.inspection.layer_shift import coarse_shift, finer_shift
from registration.inspection.noise import BareStrips, Noise, log_alike, noise_of
from registration.inspection.options import SeeingOptions
from registration.inspection.passes import REACH, Passes, Pieces
from registration.inspection.picture import LOWEST, View, ViewFrame
from registration.inspection.shares import (
    ACROSS,
    NARROWEST,
    WIDEST,
    Shares,
    StripNoise,
    mean_along,
    measured,
    own_profile,
    sampled,
    strips_of,
)
from registration.inspection.values import Appearance, ExpectedLines, FloatImage, Shift
from registration.inspection.ways import Seen, Ways

_ROUNDS: Final = 5
_LAST_MOVE: Final = 2
"""Rounds at the end in which the shift rests, and profiles have all their parts."""
_OVER: Final = (0.65, 0.35)
"""Widths from the middle of older ink at which there is none of it, and all."""
_OLD: Final = 0.3
"""Of a place's width over older ink: more, and it is judged against that."""
_UNSEEN: Final = 0.2
"""Of a strip's inner part that may be lost."""
_ENDS: Final = 0.5
"""Widths from a line's end, within which it isn't judged by itself: ink recedes or bulges there."""
_ROUGH: Final = 0.05
"""Scatter of heights on the ground, thicknesses of the layer."""
_INK_TELLS: Final = 0.3
"""How much ink tells of light, against ground."""
_FEWEST: Final = 100
_SETTLED: Final = 0.1
"""Change of drawn ink in a round, by which a line tells nothing of light any more."""
_EVEN: Final = 0.25
"""Widths to either side over which a line's width is averaged."""
_AS_USUAL: Final = 0.2
"""Places as wide as usual that are added to that."""


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
    near : (n, u, c) float64
        What other fresh lines add there.
    rest : (n, u, c) float64
        What the model leaves of the view across each place.
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
    near: FloatArray
    rest: FloatArray
    strips: FloatArray


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
        Inverse covariance of a strip over the ground.
    odd : bool
        Whether ink shows by slopes lit from one side alone.
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
    if view.is_heights:  # what lies below the layer is as low as bare ground
        ways, lines = _fresh_alone(ways, lines)
    pieces = Pieces.of(lines, frame)
    passes = Passes.of(pieces, view.shape)
    ground = telling_pixels(view.lost, np.abs(passes.distance).min(axis=2))
    if view.is_heights:
        own = channels[ground > 0]
        lowest = max(LOWEST, float(np.median(own))) if len(own) >= _FEWEST else LOWEST
        light = np.full_like(channels, lowest)
        mix = np.eye(1) / _ROUGH
    else:
        light = light_of(channels, ground, view.px_per_mm)
        mix = _whitening((channels - light)[ground > 0], channels - light)
    image = _mixed(channels - light, mix)
    coarse = coarse_shift(
        _without_older(image, view.lost, passes, pieces, ways, lines), view.lost, passes,
        _inner(passes, ways, lines), float(np.median(pieces.width[pieces.kind == 0])),
        options.shift_mm * view.px_per_mm, view.px_per_mm, view.is_heights,
    )  # fmt: skip
    shift = Shift(*_in_mm(coarse.by_px, frame, ways).tolist(), np.full((2, 2), np.inf))
    state = np.ones(len(ways))
    prior = None if known is None else _of_picture(known, mix)
    wide = np.ones(len(ways))
    for number in range(_ROUNDS):
        last = number >= _ROUNDS - _LAST_MOVE
        parts = tuple(range(PARTS)) if last else (ODD if coarse.odd else EVEN)
        drawn = _draw(
            view,
            frame,
            image,
            lines,
            ways,
            shift,
            state,
            wide,
            parts,
            options,
            prior,
            number == 0,
            not coarse.odd,
        )
        shown, shares, noise, misfit, states, inverse = _judge(
            view, image, drawn, state, prior is not None
        )
        before = state * wide
        state = _presence(states, shares.level)
        wide = _wide(states, shares.wider, shown, ways)
        settled = np.clip(1.0 - np.abs(state * wide - before) / _SETTLED, 0.0, 1.0)
        if not last:
            shift = finer_shift(
                shift, shares.offset, drawn.ways, shown & (state > 0.5), options, coarse.odd
            )
        if not view.is_heights and not last:
            light = light + _light_left(
                view, image, drawn, ground, mix, _of_places(drawn.passes, ways, lines, settled)
            )
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
    )


def _fresh_alone(ways: Ways, lines: ExpectedLines) -> tuple[Ways, ExpectedLines]:
    """Places and lines without older ones."""
    row = np.cumsum(lines.fresh) - 1
    some = ExpectedLines(**{name: value[lines.fresh] for name, value in vars(lines).items()})
    return replace(ways, piece=row[ways.piece]), some


def _inner(passes: Passes, ways: Ways, lines: ExpectedLines) -> FloatImage:
    """How much each pass tells of a layer's place, (h, w, 4): not by ends, which recede."""
    weight = np.clip(2.0 * ways.to_end / ways.width - 1.0, 0.0, 1.0)
    fresh = np.append(lines.fresh, False)[passes.piece]
    return np.where(fresh, _of_places(passes, ways, lines, weight), 0.0).astype(np.float32)


def _of_places(passes: Passes, ways: Ways, lines: ExpectedLines, value: FloatArray) -> FloatImage:
    """Values (n,) of the places that pass each pixel, (h, w, 4); 1 where there is none."""
    share = ShareOfPiece.along(ways, lines, value)
    first, many = np.append(share.first, 0.0), np.append(share.many, 0.0)
    low, high = (np.append(one, len(ways)) for one in (share.low, share.high))
    at = (first[passes.piece] + passes.part * many[passes.piece]).astype(np.int64)
    at = np.clip(at, low[passes.piece], high[passes.piece])
    return np.where(passes.piece >= 0, share.value[at], 1.0).astype(np.float32)


def _draw(
    view: View,
    frame: ViewFrame,
    image: FloatImage,
    lines: ExpectedLines,
    ways: Ways,
    shift: Shift,
    state: FloatArray,
    wide: FloatArray,
    parts: tuple[int, ...],
    options: SeeingOptions,
    prior: InkModel | None,
    first: bool,
    plain: bool,
) -> Drawn:
    """Fit profiles at a shift (``first`` with what is known of them), and take strips."""
    by = np.array([shift.dx_mm, shift.dy_mm])
    off = np.where(lines.fresh[:, None], np.append(by, 0.0), 0.0)
    moved = replace(lines, start=lines.start + off, end=lines.end + off)
    there, pieces = ways.moved(by), Pieces.of(moved, frame)
    passes, seen = Passes.of(pieces, view.shape), Seen.of(there, frame, options.round_lines)
    older = passes.nearest(pieces.kind, 1)
    over = np.clip((_OVER[0] - older) / (_OVER[0] - _OVER[1]), 0.0, 1.0).astype(np.float32)
    share = ShareOfPiece.along(ways, lines, state, wide)
    model = prior
    if prior is None or not first:
        model = fitted(image, ~view.lost, passes, over, pieces.kind, share, parts, prior, plain)
    drawn = model.drawn(passes, over, pieces.kind, share)
    over_at = strips_of(over[:, :, None], seen, there)[:, :, 0]
    own = own_profile(model, over_at, seen)
    as_wide = sampled(own, ACROSS / wide[:, None])[0]
    rest = strips_of(image - drawn, seen, there)
    ink = state[:, None, None] * as_wide
    strips = rest + ink
    alone = np.zeros_like(drawn)
    if (pieces.kind == 1).any():
        none = ShareOfPiece.along(ways, lines, np.zeros(len(ways)))
        alone = model.drawn(passes, over, pieces.kind, none)
    near = strips_of(drawn - alone, seen, there) - ink
    old = over_at[:, np.abs(ACROSS) <= 0.5].mean(axis=1) > _OLD
    return Drawn(there, seen, pieces, passes, over, old, model, drawn, own, near, rest, strips)


def _judge(
    view: View, image: FloatImage, drawn: Drawn, state: FloatArray, known: bool
) -> tuple[BoolArray, Shares, Noise, FloatArray, FloatArray, FloatArray]:
    """Measure shares, learn how they scatter, and tell states."""
    ways, count = drawn.ways, len(drawn.ways)
    inner = np.abs(ACROSS) < 0.6
    lost = strips_of(view.lost[:, :, None].astype(np.float32), drawn.seen, ways)[:, inner, 0]
    shown = drawn.seen.inside(view.shape, 0.6 * ways.width) & (lost.mean(axis=1) < _UNSEEN)
    told = shown & ~ways.crossed & (ways.to_end > _ENDS * ways.width)
    shares = Shares(*np.zeros((7, count)))
    spreads, misfits, tie = np.ones((2, count)), np.zeros((2, count, 2)), 0.5
    alike = np.zeros(count)
    rest = drawn.rest
    inverse: FloatArray | None = None
    for rows, over in ((~drawn.old, None), (drawn.old, drawn.over)):
        if not rows.any():
            continue
        good = told & rows & (state > 0.5)
        own_rows = np.flatnonzero(rows)
        bare = BareStrips.laid(
            image - drawn.drawn, drawn.passes, drawn.pieces.kind, view.lost, drawn.seen, ways,
            own_rows, over,
        )  # fmt: skip
        # What a picture before shows cancels: bare older ink changes no more than the ground.
        unwritten = bare.independent if over is None or view.change is not None else 0.0
        if over is not None and view.change is not None:
            unwritten = float((np.abs(drawn.passes.distance).min(axis=2) > REACH).sum()) / (
                2.0 * (view.px_per_mm * float(np.median(ways.width))) ** 2
            )
        strip_noise = StripNoise.of(rest.reshape(count, -1)[good], bare.strips, drawn.own[rows])
        inverse = strip_noise.inverse if inverse is None or over is None else inverse
        found = measured(
            drawn.strips[rows],
            drawn.own[rows],
            drawn.near[rows],
            strip_noise,
            ways.run[rows],
            max(1, round(float(np.median(ways.width / ways.step)))),
        )
        top = _full_level(found.share[told[rows]])
        own = drawn.own * top
        found = replace(
            found, share=found.share / top, u_share=found.u_share / top, level=found.level / top
        )
        for name in ("share", "u_share", "offset", "wider", "misfit", "level"):
            getattr(shares, name)[rows] = getattr(found, name)
        if not known:
            alike[rows] = log_alike(
                float(np.median(found.u_share**-2)), float((ways.step / ways.width)[good].sum()),
                max(bare.independent, unwritten), NODES * image.shape[2],
            )  # fmt: skip
        else:
            alike[rows] = -math.inf
        log = np.log(np.maximum(shares.misfit, 1e-9))
        # Slopes that light grazes along a line show little of it there.
        usual = float(np.median(shares.u_share[good])) if good.any() else 1.0
        dim = np.maximum(1.0, shares.u_share / max(usual, 1e-9))
        each, tie, both = noise_of(
            1.0 + (shares.share - 1.0) / dim, log, good, ways.run, bare, own, strip_noise
        )
        spreads[:, rows], misfits[:, rows] = each[:, None] * dim[rows], both[:, None]
    noise = Noise(spreads[0], spreads[1], tie, misfits[0], misfits[1], alike)
    misfit = np.log(np.maximum(shares.misfit, 1e-9))
    read = np.where(told, shares.share, np.nan)
    states = posterior(read, misfit, noise, ways.run, ways.step)
    return told, shares, noise, misfit, states, inverse


def _presence(states: FloatArray, level: FloatArray) -> FloatArray:
    """How much ink is drawn at each place in the next round."""
    known = states[:, :HIDDEN].sum(axis=1)
    there = np.where(known > 0.1, 1.0 - states[:, BARE] / np.maximum(known, 1e-9), 1.0)
    thin = states[:, THIN] > 0.5
    return np.asarray(np.where(thin, np.clip(level, 0.2, 1.0), there))


def _wide(states: FloatArray, wider: FloatArray, shown: BoolArray, ways: Ways) -> FloatArray:
    """Width over the usual one at each place, with which ink is drawn in the next round.

    The mean over about half a width along the line: widths don't change faster.
    """
    weight = np.where(shown, 1.0 - states[:, BARE], 0.0)
    reach = max(1, round(_EVEN * float(np.median(ways.width / ways.step))))
    wide = 1.0 + mean_along(wider, weight, ways.run, reach, _AS_USUAL)
    usual = wide[weight > 0.5]
    # The profile is that of the layer's usual width.
    whole = float(np.median(usual)) if len(usual) else 1.0
    return np.asarray(np.clip(wide / max(whole, NARROWEST), NARROWEST, WIDEST))


def _full_level(share: FloatArray) -> float:
    """Usual share of lines that have ink, of which some may be missing."""
    if len(share) < 4:
        return 1.0
    level = float(np.percentile(share, 80))
    for _ in range(4):
        upper = share[share > 0.5 * level]
        level = float(np.median(upper)) if len(upper) else level
    return level if level > 0.05 else 1.0


def _light_left(
    view: View,
    image: FloatImage,
    drawn: Drawn,
    ground: FloatImage,
    mix: FloatArray,
    settled: FloatImage,
) -> FloatImage:
    """Light that the model leaves unexplained, (h, w, c).

    Lines that will be drawn otherwise in the next round, as they are ``settled`` (h, w, 4) less,
    tell nothing of it.
    """
    rest = _mixed(image - drawn.drawn, np.linalg.inv(mix))
    tells = settled.min(axis=2)
    weight = np.where(view.lost, 0.0, np.where(ground > 0, 1.0, _INK_TELLS * tells)).astype(
        np.float32
    )
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
    alone = ~lost & (passes.nearest(pieces.kind, 0) > REACH)
    over = np.zeros(lost.shape, dtype=np.float32)
    share = ShareOfPiece.along(ways, lines, np.zeros(len(ways)))
    model = fitted(image, alone, passes, over, pieces.kind, share, EVEN)
    return image - model.drawn(passes, over, pieces.kind, share)


def _whitening(ground: FloatArray, everything: FloatImage) -> FloatArray:
    """Matrix (c, c) that makes noise of the ground 1 in each channel and independent."""
    count = everything.shape[2]
    own = ground if len(ground) >= _FEWEST else everything.reshape(-1, count)
    low, high = np.percentile(own, [1, 99], axis=0)
    inner = own[((own >= low) & (own <= high)).all(axis=1)]
    cov = np.cov(inner.T).reshape(count, count)
    cov += (1e-3 * np.trace(cov) / count + 1e-8) * np.eye(count)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(cov)))


def _mixed(values: FloatImage, mix: FloatArray) -> FloatImage:
    return np.ascontiguousarray(values @ mix.T.astype(np.float32))


def _of_picture(known: Appearance, mix: FloatArray) -> InkModel | None:
    """What ink would add to the whitened view; None where it had other channels."""
    if known.profile.shape[3] != len(mix):
        return None
    return InkModel(known.profile @ mix.T)


def _in_mm(by_px: FloatArray, frame: ViewFrame, ways: Ways) -> FloatArray:
    """A move of the view's pixels as one on the layer's plane, (2,)."""
    middle = ways.point.mean(axis=0)
    base = frame.to_pixels(np.stack([middle, middle + (1, 0, 0), middle + (0, 1, 0)]))
    return np.linalg.solve((base[1:] - base[0]).T, by_px)
