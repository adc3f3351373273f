"""Tell fresh ink over older ink by what changed since a picture taken before the layer.

Where a line is missing nothing changed. What changed where it was written hangs on the ink:

- translucent ink: another line's density, so the level moves towards the ink's own colour;
- opaque ink: ridges and texture of the old surface go, and those of the new one come. The level
  needn't change, but there is an amount of change;
- opaque, matte ink in even light: nothing, and so nothing is told.

Both signs are tried, and the layer's own lines tell which one shows them better. A level that
changes by no more than light and evaporation may change it isn't a sign, and neither is what lies
in both pictures (a bubble that stayed, a speck).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from registration.layer_images.ink_image import ACROSS, BathNoise, Template, angle_of, channel_mix
from registration.layer_images.presence import fake_places, window_noise
from registration.layer_images.strange import grown
from registration.layer_images.told import LONG, Told, reasons
from registration.layer_images.values import (
    Appearance,
    BoolArray,
    FloatArray,
    FloatImage,
    Gap,
    IntArray,
    Unseen,
)
from registration.layer_images.ways import Seen, Ways
from registration.layer_images.working import Mask, Working

_LEAST_STEP: Final = 0.025
"""Logarithm by which ink must change the level: drying and stray light change it by less."""
_OF_LIGHT: Final = 0.12
"""And that share of what the light changed by: sensors aren't quite linear."""
_SOFT: Final = 0.12
"""Of a width, over which the difference is smoothed."""
_CORE = np.linspace(-0.32, 0.32, 9)
_FEWEST: Final = 60
_LEAST_INK: Final = 0.35
"""Of the places, that must show the change that is taken for ink's."""
_HIGHEST: Final = 75.0
_UNCHANGED: Final = 0.3
"""Most change, over ink's, in a gap: more is thin ink, or a veil over both pictures."""
_STILL: Final = 5.0
"""Standard deviations by which a thing that lay there before stands out."""
_LOW, _HIGH = -0.4, 3.0
"""Change, over ink's, of a bubble that came or went."""
_FULL: Final = 1.5
"""Change, over ink's, that counts at most."""
_TOLD: Final = 0.35
"""Share of the fresh surface, over the usual, that missing ink must stay below to be told."""
_BINS: Final = 8
_MOST: Final = 100_000


@dataclass(frozen=True)
class Places:
    """Where the change is judged.

    Attributes
    ----------
    ways, seen
    use : (n,) bool
        Over older ink.
    settled : (n,) bool
        Nothing but the layer was written there since the picture before.
    ground : (h, w) uint8
        Where nothing was written since.
    ink : (h, w) uint8
        Where older ink lay.
    earlier : (h, w, c) float32
        The picture before, light taken out.
    """

    ways: Ways
    seen: Seen
    use: BoolArray
    settled: BoolArray
    ground: Mask
    ink: Mask
    earlier: FloatImage


def tell_by_change(
    work: Working, places: Places, gap_mm: float, rate: float, rng: np.random.Generator
) -> Told | None:
    """Judge places over older ink; None where what changed doesn't tell.

    Parameters
    ----------
    work : Working
        With a picture before.
    places : Places
    gap_mm : float, mm
    rate : float
        False findings per sound layer.
    rng : Generator
    """
    if work.earlier is None or cv2.countNonZero(places.ground) < _FEWEST:
        return None
    width_px = float(np.median(places.ways.width)) * work.px_per_mm
    step_px = float(np.median(places.ways.step)) * work.px_per_mm
    fakes = fake_places(places.ground, width_px, step_px, rng)
    if fakes is None:
        return None
    still = _still(places, width_px)
    best: Told | None = None
    for sign in _signs(work, places, fakes, width_px, rng):
        told = _by_sign(sign, still, work, places, gap_mm, rate)
        if told is not None and (best is None or _rank(told, places) > _rank(best, places)):
            best = told
    return best


def _rank(told: Told, places: Places) -> tuple[bool, int, float]:
    """Which sign is the better one: that which tells a tolerated gap, at more places."""
    return not told.faint, int((told.why[places.use] == Unseen.SEEN).sum()), told.contrast


@dataclass(frozen=True)
class _Sign:
    """A figure of what changed.

    Attributes
    ----------
    image : (h, w) float32
        Where it was much, somewhere.
    value : (n,) float64
        Of each place; 0 where nothing changed.
    nothing : (f,) float64
        The same of ground, in rows of eight places.
    step : float
        Logarithm by which ink changes the level; 0 where it doesn't count.
    told : (n,) bool
        Where missing ink would differ from sound ink.
    """

    image: FloatImage
    value: FloatArray
    nothing: FloatArray
    step: float
    told: BoolArray


def _signs(
    work: Working, places: Places, fakes: Seen, width_px: float, rng: np.random.Generator
) -> Iterator[_Sign]:
    """Level, where it changed by more than light and drying do it; and amount of detail."""
    count = work.channels.shape[2] // 2
    raw = work.channels[:, :, count:]
    light = _light(raw, places.ground)
    blur = max(0.6, _SOFT * width_px)
    level = cv2.GaussianBlur(raw - light, (0, 0), blur).reshape(raw.shape)
    ground = BathNoise.of(level, places.ground, rng)
    if ground is None:
        return
    rows = places.use & places.settled
    ways, px_core = places.ways, width_px * _CORE[None, :]
    step = _usual_step(_core(level, places.seen, ways.width[:, None] * _CORE).mean(axis=1)[rows])
    least = _LEAST_STEP + _OF_LIGHT * float(np.abs(light[places.ground > 0]).max())
    if np.abs(step).max() >= least:
        mix = channel_mix(level, ground, places.seen, ways.width, rows).astype(np.float32)
        mix *= np.float32(np.sign(step @ mix))
        mixed = np.asarray((level - ground.mean.astype(np.float32)) @ mix)[:, :, None]
        yield _Sign(
            mixed[:, :, 0],
            _core(mixed, places.seen, ways.width[:, None] * _CORE).mean(axis=(1, 2)),
            _core(mixed, fakes, px_core).mean(axis=(1, 2)),
            float(step[np.argmax(np.abs(step))]),
            places.use,
        )
    now = work.channels[:, :, :count]
    scale = _noise(raw, now, blur)
    now = cv2.GaussianBlur(now, (0, 0), blur).reshape(raw.shape) / scale
    level = level / scale
    quiet = _detail(_core(level, fakes, px_core), np.repeat(np.arange(len(fakes.at) // 8), 8))
    across = ways.width[:, None] * _CORE
    sign = _by_surface(
        _core(now, places.seen, across), _core(level, places.seen, across), places,
        float(np.median(quiet)), np.sqrt((level**2).mean(axis=2)),
    )  # fmt: skip
    if sign is not None:
        yield sign


def _by_surface(
    now: FloatArray, change: FloatArray, places: Places, quiet: float, image: FloatImage
) -> _Sign | None:
    """Whose surface each place shows: that of sound fresh lines (1), or the one before (0).

    What differs from the old surface is held against what differs from a usual fresh line: s / (s
    + f), both squared. Where both differ nothing is known (a gap's shade), and where the old
    surface looks like a fresh line a gap can't be told.
    """
    ways, rows = places.ways, places.use & places.settled
    angle = angle_of(places.seen)
    old = _detail(change, ways.run) ** 2
    keep = rows & (old >= np.median(old[rows]))
    share = np.zeros(len(ways))
    plain = now - now.mean(axis=1, keepdims=True)
    for _ in range(4):
        if keep.sum() < _FEWEST:
            return None
        line = _usual_line(plain, angle, keep)
        share = old / np.maximum(old + _detail(now - line, ways.run) ** 2, 1e-12)
        keep = rows & (share > 0.5 * np.percentile(share[rows], _HIGHEST))
    missing = quiet**2 / np.maximum(quiet**2 + _detail(now - change - line, ways.run) ** 2, 1e-12)
    told = rows & (missing < _TOLD * float(np.percentile(share[rows], _HIGHEST)))
    if told.sum() < _FEWEST:
        return None
    nothing = missing[told]
    return _Sign(image, share, nothing[: len(nothing) // 8 * 8], 0.0, told)


def _usual_line(plain: FloatArray, angle: FloatArray, keep: BoolArray) -> FloatArray:
    """What fresh lines look like across by their direction in the picture, (n, u, c)."""
    turned = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    a = turned[keep]
    power = a.T @ a + 1e-3 * len(a) * np.eye(3)
    terms = np.linalg.solve(power, np.tensordot(a.T, plain[keep], axes=1).reshape(3, -1))
    return (turned @ terms).reshape(plain.shape)


def _core(image: FloatImage, seen: Seen, across: FloatArray) -> FloatArray:
    """Each channel in the middle of lines, (n, u, c)."""
    parts = [
        seen.profiles(np.ascontiguousarray(image[:, :, c]), across) for c in range(image.shape[2])
    ]
    return np.stack(parts, axis=2).astype(np.float64)


def _detail(core: FloatArray, run: IntArray) -> FloatArray:
    """Standard deviation within a place (n, u, c) and its neighbours of the run, (n,).

    An even change (drying, light) doesn't count.
    """
    first, second = core.mean(axis=1), (core**2).mean(axis=1)
    count = np.ones((len(core), 1))
    sums = [count.copy(), first.copy(), second.copy()]
    same = (run[1:] == run[:-1])[:, None]
    for total, part in zip(sums, (count, first, second), strict=True):
        total[1:] += part[:-1] * same
        total[:-1] += part[1:] * same
    variance = sums[2] / sums[0] - (sums[1] / sums[0]) ** 2
    return np.asarray(np.sqrt(np.maximum(variance, 0.0).mean(axis=1)))


def _by_sign(
    sign: _Sign,
    still: BoolArray,
    work: Working,
    places: Places,
    gap_mm: float,
    rate: float,
) -> Told | None:
    ways, use = places.ways, places.use
    why = reasons(work, places.seen, ways, still | work.bad)
    told = places.settled & sign.told
    why = np.where((why == Unseen.SEEN) & ~told, int(Unseen.OLD_INK), why)
    level = _ink_level(sign.value, ways, use & (why == Unseen.SEEN))
    if level is None:
        return None
    usual = float(np.nanmedian(level[use]))
    image = np.asarray(sign.image / np.float32(usual))
    if sign.step:
        width_px = float(np.median(ways.width)) * work.px_per_mm
        passed = _passed(image, places, width_px)
        why = np.maximum(why, reasons(work, places.seen, ways, passed))
    why = np.where((why == Unseen.SEEN) & ~np.isfinite(level), int(Unseen.OLD_INK), why)
    # Whatever is above ink's is ink; how much mustn't count as noise.
    present = np.where(np.isfinite(level), np.minimum(sign.value / level, _FULL), 0.0)
    good = use & (why == Unseen.SEEN)
    noise = window_noise(present, good, ways, sign.nothing / usual, gap_mm, known=False)
    if noise is None:
        return None
    number = max(1.0, float(ways.step[good].sum()) / gap_mm)
    if not noise.can_tell(LONG * gap_mm, rate / number):
        return None
    flat = np.zeros((3, len(ACROSS)))
    flat[0] = 1.0
    count = work.channels.shape[2]
    return Told(
        image=image,
        profiles=np.zeros((len(ways), len(ACROSS)), dtype=np.float32),
        present=present,
        plain=present,
        why=np.asarray(why),
        template=Template(flat, 1.0, True),
        noise=noise,
        contrast=noise.contrast(gap_mm),
        strange=still,
        appearance=Appearance(np.zeros(count), flat, True),
        bath_spread=noise.bath,
        log_step=sign.step,
        ink=np.zeros(count),
        faint=not noise.can_tell(gap_mm, rate / number),
    )


def _usual_step(at: FloatArray) -> FloatArray:
    """Level (c,) that ink changes by; half of the places (n, c) may show none."""
    low, high = np.percentile(at, [100 - _HIGHEST, _HIGHEST], axis=0)
    step = np.where(np.abs(low) > np.abs(high), low, high)
    for _ in range(4):
        share = at @ step / max(float(step @ step), 1e-18)
        keep = np.abs(share - 1.0) < 0.5
        if keep.sum() < _FEWEST:
            return np.asarray(np.median(at, axis=0))
        step = np.median(at[keep], axis=0)
    return np.asarray(step)


def _ink_level(value: FloatArray, ways: Ways, use: BoolArray) -> FloatArray | None:
    """Change by sound ink at all places, (n,): a surface of second order through the usual ones.

    NaN where it is small; None where too few places show it.
    """
    if use.sum() < _FEWEST:
        return None
    point = ways.point[:, :2]
    x, y = (point - point.mean(axis=0)).T / max(float(np.ptp(point, axis=0).max()), 1e-6)
    basis = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    level = np.full(len(value), float(np.percentile(value[use], _HIGHEST)))
    near = use
    for terms in (1, 1, 3, 3, 6, 6):
        if not (level[use] > 0).any():
            return None
        near = use & (np.abs(value - level) < 0.5 * np.maximum(level, 1e-12))
        if near.sum() < max(_FEWEST, _LEAST_INK * use.sum()):
            return None
        a = basis[near, :terms]
        pull = 1e-3 * len(a) * np.eye(terms)
        pull[0, 0] = 0.0
        level = basis[:, :terms] @ np.linalg.solve(a.T @ a + pull, a.T @ value[near])
    least = 0.3 * float(np.median(level[near]))
    return np.where(level > least, level, np.nan)


def _powers(x: FloatArray, y: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    u, v = 2.0 * x / shape[1] - 1.0, 2.0 * y / shape[0] - 1.0
    return np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])


def _drawn_surface(terms: FloatArray, shape: tuple[int, ...]) -> FloatImage:
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    basis = _powers(x.ravel(), y.ravel(), shape)
    return np.asarray(basis @ terms, dtype=np.float32).reshape(shape[0], shape[1], -1)


def _surface(
    x: FloatArray, y: FloatArray, values: FloatArray, shape: tuple[int, ...]
) -> FloatArray:
    """Terms (6, c) of a surface of second order by Huber's weights."""
    basis = _powers(x, y, shape)
    found = []
    for c in range(values.shape[1]):
        weight = np.ones(len(basis))
        for _ in range(5):
            power = (basis.T * weight) @ basis + 1e-6 * len(basis) * np.eye(6)
            terms = np.linalg.solve(power, (basis.T * weight) @ values[:, c])
            off = np.abs(values[:, c] - basis @ terms)
            weight = np.minimum(1.0, 2.0 * float(np.median(off)) / np.maximum(off, 1e-12))
        found.append(terms)
    return np.stack(found, axis=1)


def _light(raw: FloatImage, ground: Mask) -> FloatImage:
    """How the light changed, by the ground, (h, w, c)."""
    y, x = np.nonzero(ground)
    some = slice(None, None, max(1, len(x) // _MOST))
    y, x = y[some], x[some]
    terms = _surface(x.astype(float), y.astype(float), raw[y, x].astype(np.float64), raw.shape)
    return _drawn_surface(terms, raw.shape)


def _noise(raw: FloatImage, now: FloatImage, blur: float) -> FloatImage:
    """Standard deviation of the smoothed difference by noise, by brightness, (h, w, c).

    The finest detail of a difference is noise alone; surfaces and their shades are smoother.
    """
    fine = raw - cv2.GaussianBlur(raw, (0, 0), 1.0).reshape(raw.shape)
    kernel = cv2.getGaussianKernel(31, blur)
    kept = float((kernel**2).sum())  # of white noise, root of the variance in two directions
    out = np.empty_like(raw)
    for c in range(raw.shape[2]):
        edges = np.quantile(now[:, :, c], np.linspace(0, 1, _BINS + 1))
        number = np.clip(np.searchsorted(edges, now[:, :, c]) - 1, 0, _BINS - 1)
        spread = np.array(
            [np.median(np.abs(fine[:, :, c][number == k])) if (number == k).any() else 0.0
             for k in range(_BINS)]
        )  # fmt: skip
        middle = 0.5 * (edges[1:] + edges[:-1])
        usual = 1.4826 * np.maximum(spread, 0.2 * float(np.median(spread)) + 1e-6)
        out[:, :, c] = kept * np.interp(now[:, :, c], middle, usual)
    return out


def _still(places: Places, width_px: float) -> BoolArray:
    """What stood out from older ink before: a bubble, a speck; it may lie there still, (h, w)."""
    inside = _inside(places, width_px)
    if inside.sum() < _FEWEST:
        return np.zeros(inside.shape, dtype=np.bool_)
    soft = cv2.GaussianBlur(places.earlier, (0, 0), max(0.6, 2 * _SOFT * width_px))
    soft = soft.reshape(places.earlier.shape)
    some = soft[inside]
    middle = np.median(some, axis=0)
    low, high = np.percentile(some, [10, 90], axis=0)
    spread = np.maximum(middle - low, high - middle) / 1.2816 + 1e-3
    odd = (np.abs(soft - middle) > _STILL * spread).any(axis=2) & inside
    return grown(odd, width_px)


def _passed(share: FloatImage, places: Places, width_px: float) -> BoolArray:
    """What changed otherwise than ink does: a bubble that came or went, (h, w)."""
    noise = float(share[places.ground > 0].std())
    odd = (share < _LOW - 5.0 * noise) | (share > _HIGH + 5.0 * noise)
    return grown(odd & _inside(places, width_px), width_px)


def _inside(places: Places, width_px: float) -> BoolArray:
    """Older ink away from the bath, (h, w)."""
    side = 2 * round(0.35 * width_px) + 3
    return np.asarray(cv2.erode(places.ink, np.ones((side, side), np.uint8)) > 0)


def unchanged(
    gaps: list[Gap], present: FloatArray, good: BoolArray, ways: Ways
) -> tuple[list[Gap], BoolArray]:
    """Return gaps in which nothing changed, and the places of all others, (n,)."""
    kept, doubtful = [], np.zeros(len(ways), dtype=np.bool_)
    for gap in gaps:
        own = (ways.stroke == gap.stroke) & (ways.along >= gap.from_mm) & (ways.along <= gap.to_mm)
        if float(np.median(present[own & good])) < _UNCHANGED:
            kept.append(gap)
        else:
            doubtful |= own
    return kept, doubtful
