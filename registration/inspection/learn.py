"""Learn light, the layer's shift, ink's profile and each place's share of ink from one look."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.chain import BARE, FULL, HIDDEN, THIN, Noise, posterior
from registration.inspection.ground import light_of, telling_pixels
from registration.inspection.ink_model import InkModel, ShareOfPiece, fitted
from registration.inspection.layer_shift import coarse_shift
from registration.inspection.options import SeeingOptions
from registration.inspection.passes import Passes, Pieces
from registration.inspection.picture import View, ViewFrame
from registration.inspection.shares import (
    ACROSS,
    Shares,
    StripNoise,
    measured,
    own_profile,
    strips_of,
)
from registration.inspection.values import ExpectedLines, FloatImage
from registration.inspection.ways import Seen, Ways, from_stroke_begin

_ROUNDS: Final = 4
_BARE: Final = 2000
_OVER: Final = (0.65, 0.35)
"""Widths from the middle of older ink at which there is none of it, and all."""


@dataclass(frozen=True)
class Learned:
    """All that was learned of a look.

    Attributes
    ----------
    shift_mm : (2,) float64, mm
    states : (n, 4) float64
        Probabilities of full, thin, bare and hidden at each place.
    """

    view: View
    frame: ViewFrame
    ways: Ways
    seen: Seen
    shift_mm: FloatArray
    covariance_mm2: FloatArray
    image: FloatImage
    rest: FloatImage
    passes: Passes
    pieces: Pieces
    over: FloatImage
    over_at: FloatArray
    model: InkModel
    own: FloatArray
    strips: FloatArray
    shares: Shares
    noise: Noise
    misfit: FloatArray
    states: FloatArray
    strip_noise: StripNoise
    odd: bool = False


def learned(
    view: View, frame: ViewFrame, lines: ExpectedLines, ways: Ways, options: SeeingOptions
) -> Learned:
    pieces, share = _pieces(lines, frame, ways, options)
    passes = Passes.of(pieces, view.shape)
    away = np.minimum(passes.nearest(pieces.kind, 0), passes.nearest(pieces.kind, 1))
    ground = telling_pixels(view.lost, away)
    channels = view.channels
    light = light_of(channels, ground, view.px_per_mm, local=not view.is_heights)
    image = _whitened(channels - light, ground)
    free = ~view.lost
    width_px = float(np.median(pieces.width[pieces.kind == 0]))
    coarse = coarse_shift(
        image, view.lost, passes, pieces.kind, width_px, options.shift_mm * view.px_per_mm,
        view.px_per_mm,
    )  # fmt: skip
    shift = _in_mm(coarse.by_px, frame, ways)
    simple = (1, 2) if coarse.odd else (0, 3, 4)
    state = np.ones(len(ways))
    for number in range(_ROUNDS):
        moved = ways.moved(shift)
        pieces, share = _pieces(_moved(lines, shift), frame, moved, options)
        passes = Passes.of(pieces, view.shape)
        seen = Seen.of(moved, frame, options.round_lines)
        older = passes.nearest(pieces.kind, 1)
        over = np.clip((_OVER[0] - older) / (_OVER[0] - _OVER[1]), 0.0, 1.0).astype(np.float32)
        now = share.of(state)
        last = number == _ROUNDS - 1
        parts = tuple(range(5)) if last else simple
        model = fitted(image, free, passes, over, pieces.kind, now, parts)
        rest = image - model.drawn(passes, over, pieces.kind, now)
        over_at = strips_of(over[:, :, None], seen, moved)[:, :, 0]
        own = own_profile(model, over_at, seen)
        strips = strips_of(rest, seen, moved) + state[:, None, None] * own
        shown = seen.inside(view.shape, ways.width)
        lost = strips_of(view.lost[:, :, None].astype(np.float32), seen, moved)[:, :, 0]
        shown &= lost[:, np.abs(ACROSS) < 0.6].mean(axis=1) < 0.2
        # Twice: noise by the rest of full strips first.
        good = shown & (state > 0.5) & ~moved.crossed
        rests = (strips - state[:, None, None] * own).reshape(len(ways), -1)[good]
        bare, which = _bare_strips(rest, passes, view, seen, ways, width_px)
        strip_noise = StripNoise.of(rests, bare)
        on_ground = measured(bare.reshape(len(bare), len(ACROSS), -1), own[which], strip_noise)
        shares = measured(strips, own, strip_noise)
        top = _full_level(shares.share[good])
        shares = replace(shares, share=shares.share / top, u_share=shares.u_share / top)
        noise, misfit = _noise(shares, on_ground, good, ways, top)
        known = np.where(shown & ~moved.crossed, shares.share, np.nan)
        states = posterior(known, misfit, noise, ways.run, ways.step)
        p = states[:, :HIDDEN].sum(axis=1)
        state = np.where(p > 0.1, 1.0 - states[:, BARE] / np.maximum(p, 1e-9), 1.0)
        thin = states[:, THIN] > 0.5
        state = np.where(thin, np.clip(shares.share, 0.2, 1.0), state)
        step, cov = _offset(shares, good, ways, state)
        if number < _ROUNDS - 2:
            shift = shift + step

    return Learned(
        view, frame, ways, seen, shift, cov, image, rest, passes, pieces, over, over_at, model,
        own, strips, shares, noise, misfit, states, strip_noise, coarse.odd,
    )  # fmt: skip


def _full_level(share: FloatArray) -> float:
    if len(share) < 4:
        return 1.0
    level = float(np.percentile(share, 70))
    for _ in range(4):
        upper = share[share > 0.5 * level]
        level = float(np.median(upper)) if len(upper) else level
    return level if level > 0.05 else 1.0


def _bare_strips(rest, passes, view, seen, ways, width_px):
    """Strips laid across unwritten ground, (k, u c), and the places whose directions they have."""
    rng = np.random.default_rng(26)
    clear = ((passes.count == 0) & ~view.lost).astype(np.uint8)
    clear = cv2.copyMakeBorder(clear, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    room = cv2.distanceTransform(clear, cv2.DIST_L2, 5)[1:-1, 1:-1]
    y, x = np.nonzero(room > width_px)
    if len(y) < 200:
        return np.zeros((0, len(ACROSS) * rest.shape[2])), np.zeros(0, dtype=np.int64)
    pick = rng.integers(0, len(y), _BARE)
    which = rng.integers(0, len(ways), _BARE)
    at = np.column_stack([x[pick], y[pick]]).astype(np.float64)
    laid = Seen(at, seen.across[which], seen.along[which])
    bare = strips_of(rest, laid, ways.only(which))
    return bare.reshape(_BARE, -1), which


def _noise(shares, ground, good, ways, top):
    x = shares.share[good]
    near = np.abs(x - 1.0) < 0.5 if (np.abs(x - 1.0) < 0.5).any() else np.ones(len(x), bool)
    spread = max(1.4826 * float(np.median(np.abs(x[near] - 1.0))), 0.02) if len(x) else 1.0
    one = np.flatnonzero(good[1:] & good[:-1] & (ways.run[1:] == ways.run[:-1]))
    a, b = shares.share[one] - 1.0, shares.share[one + 1] - 1.0
    ok = (np.abs(a) < 3 * spread) & (np.abs(b) < 3 * spread)
    tie = float((a * b)[ok].sum() / max((a * a)[ok].sum(), 1e-9)) if ok.any() else 0.5
    tie = min(max(tie, 0.0), 0.95)
    q = np.log(np.maximum(shares.misfit, 1e-9))
    q_full, s_full = _level(q[good])
    if len(ground.share):
        bare = 1.4826 * float(np.median(np.abs(ground.share))) / top
        q_bare, s_bare = _level(np.log(np.maximum(ground.misfit, 1e-9)))
    else:
        bare, q_bare, s_bare = spread, q_full, s_full
    bare = np.maximum(np.hypot(bare, 0.08), spread)
    noise = Noise(np.full(len(ways), spread), np.full(len(ways), bare), tie, tie, (q_full, s_full), (q_bare, s_bare))
    return noise, q


def _level(values):
    if not len(values):
        return 0.0, 1.0
    middle = float(np.median(values))
    return middle, max(1.4826 * float(np.median(np.abs(values - middle))), 0.1)


def _offset(shares, good, ways, state):
    use = good & (state > 0.5)
    off, normal = shares.offset[use] * ways.width[use], ways.normal[use]
    if not use.any():
        return np.zeros(2), np.full((2, 2), np.inf)
    spread = max(1.4826 * float(np.median(np.abs(off - np.median(off)))), 1e-4)
    weight = 1.0 / (1.0 + (off / (3 * spread)) ** 2)
    n_eff = use.sum() / 8.0
    power = (normal * weight[:, None]).T @ normal / spread**2 * (n_eff / use.sum())
    power += np.eye(2) / 0.3**2
    score = (normal * weight[:, None]).T @ off / spread**2 * (n_eff / use.sum())
    cov = np.linalg.inv(power)
    return cov @ score, cov


def _moved(lines: ExpectedLines, shift: FloatArray) -> ExpectedLines:
    by = np.where(lines.fresh[:, None], np.append(shift, 0.0), 0.0)
    return replace(lines, start=lines.start + by, end=lines.end + by)


def _in_mm(by_px, frame, ways):
    middle = ways.point.mean(axis=0)
    base = frame.to_pixels(np.stack([middle, middle + (1, 0, 0), middle + (0, 1, 0)]))
    jac = np.column_stack([base[1] - base[0], base[2] - base[0]])
    return np.linalg.solve(jac, by_px)


def _whitened(image, ground):
    own = image[ground > 0]
    c = image.shape[2]
    if len(own) < 100:
        own = image.reshape(-1, c)
    low, high = np.percentile(own, [1, 99], axis=0)
    keep = ((own >= low) & (own <= high)).all(axis=1)
    cov = np.cov(own[keep].T).reshape(c, c) + 1e-8 * np.eye(c)
    cov += 1e-3 * np.trace(cov) / c * np.eye(c)
    inv = np.linalg.inv(np.linalg.cholesky(cov))
    return np.ascontiguousarray(image @ inv.T.astype(np.float32))


def _pieces(lines, frame, ways, options):
    middle = 0.5 * (lines.start + lines.end)
    way = lines.end - lines.start
    flat = np.linalg.norm(way[:, :2], axis=1)
    unit = way[:, :2] / np.maximum(flat, 1e-9)[:, None]
    normal = np.column_stack([-unit[:, 1], unit[:, 0], np.zeros(len(unit))])
    start, end = frame.to_pixels(lines.start), frame.to_pixels(lines.end)
    h = 0.5 * lines.width_mm[:, None]
    across = frame.to_pixels(middle + h * normal) - frame.to_pixels(middle - h * normal)
    along = end - start
    length_px = np.linalg.norm(along, axis=1)
    cross = np.abs(across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0])
    width = np.where(length_px > 1e-6, cross / np.maximum(length_px, 1e-6), 0.0)
    small = width < 0.3 * np.median(width)
    width = np.where(small, np.linalg.norm(across, axis=1), width)
    scale = width / lines.width_mm
    length = np.linalg.norm(way, axis=1)
    begin = from_stroke_begin(lines.stroke, length)
    pieces = Pieces(
        np.ascontiguousarray(start), np.ascontiguousarray(end), width, begin * np.median(scale),
        lines.stroke.astype(np.int64), np.where(lines.fresh, 0, 1).astype(np.int64),
    )
    n = len(ways)
    first = np.full(len(lines), float(n))
    many = np.zeros(len(lines))
    low = np.full(len(lines), n, dtype=np.int64)
    high = low.copy()
    runs = np.flatnonzero(np.concatenate([[True], np.diff(ways.run) != 0]))
    ends = np.append(runs[1:], n) - 1
    for a, b in zip(runs, ends):
        s = ways.step[a]
        begin_run = ways.along[a] - 0.5 * s
        rows = np.flatnonzero(
            (lines.stroke == ways.stroke[a]) & lines.fresh
            & (begin + length > begin_run - 1e-6) & (begin < ways.along[b] + 0.5 * s + 1e-6)
        )
        first[rows] = a + (begin[rows] - begin_run) / s
        many[rows] = length[rows] / s
        low[rows], high[rows] = a, b
    return pieces, ShareOfPiece(first, many, low, high, np.ones(n + 1))
