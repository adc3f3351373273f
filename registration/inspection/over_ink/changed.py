"""Detect missing ink on older ink by what changed since a picture taken before the layer.

Translucent ink adds a line's density to what lies below, so the level moves towards the ink's own
colour, and where a line is missing nothing changed. Opaque ink changes no level but its ridges and
their shades alone. Those don't tell missing ink reliably: a groove is shaded by the lines beside
it, and a new surface is like the old one here and there by chance. So nothing is told then, and
neither where the level changed by no more than light and drying may change it. What lay in both
pictures (a bubble that stayed, a speck) hides what is below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.ndimage import uniform_filter1d

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_image import BathNoise, channel_mix
from registration.inspection.ink.level_told import told_by_level
from registration.inspection.ink.place_reasons import reasons
from registration.inspection.ink.presence import fake_places, window_noise
from registration.inspection.ink.strange import grown
from registration.inspection.ink.told import Told
from registration.inspection.pictures.working import Mask, Working
from registration.inspection.values import FloatImage, Gap, Unseen
from registration.inspection.ways import Seen, Ways

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
"""Most change, over ink's, in a gap: more is thin ink, a veil over both pictures; or, the other
way, a glare or bubble that went."""
_STILL: Final = 5.0
"""Standard deviations by which a thing that lay there before stands out."""
_AROUND: Final = 1.5
"""Widths; from what lies so far around."""
_ALONG: Final = 7
_STILL_ALONG: Final = 4.0
"""The same of so many places along a line together."""
_LOW, _HIGH = -0.4, 1.8
"""Change, over ink's, of a bubble that came or went."""
_SHORTEST: Final = 0.75
"""Of a width: what is shorter may be a small bubble as bright as older ink."""
_ALIKE: Final = 0.6
"""Of the most change on older ink of any height; on ink of a height with less it isn't told."""
_FEWEST_ALIKE: Final = 12
_SHADED, _MUCH = 0.1, 0.35
"""Change in a gap, over ink's, of level and ridges together, from which on it is doubted, and not
told. Lines that touch shade a bare one by 0.3; opaque ink that is level as what it lies on changed
by 0.24 to 1.2 (60 stretches)."""
_FULL: Final = 1.5
"""Change, over ink's, that counts at most."""
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
    onto : (n,) int64
        Rank, from below, of the height of the topmost older ink there.
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
    onto: IntArray
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
    ways, use = places.ways, places.use
    width_px = float(np.median(ways.width)) * work.px_per_mm
    step_px = float(np.median(ways.step)) * work.px_per_mm
    fakes = fake_places(places.ground, width_px, step_px, rng)
    found = None if fakes is None else _changed(work, places, width_px, rng)
    if fakes is None or found is None:
        return None
    image, log_step = found
    strange = _still(places, width_px) | work.bad
    why = reasons(work, places.seen, ways, strange)
    why = np.where((why == Unseen.SEEN) & _stands_out(places), int(Unseen.GLARE), why)
    why = np.where((why == Unseen.SEEN) & ~places.settled, int(Unseen.OLD_INK), why)
    value = _core(image[:, :, None], places.seen, ways.width[:, None] * _CORE)[:, 0]
    alike = _changed_alike(value, use & (why == Unseen.SEEN), places.onto)
    why = np.where((why == Unseen.SEEN) & ~alike, int(Unseen.OLD_INK), why)
    level = _ink_level(value, ways, use & (why == Unseen.SEEN))
    if level is None:
        return None
    usual = float(np.nanmedian(level[use]))
    image = np.asarray(image / np.float32(usual))
    passed = _passed(image, places, width_px)
    why = np.maximum(why, reasons(work, places.seen, ways, passed))
    why = np.where((why == Unseen.SEEN) & ~np.isfinite(level), int(Unseen.OLD_INK), why)
    # Whatever is above ink's is ink; how much mustn't count as noise.
    present = np.where(np.isfinite(level), np.minimum(value / level, _FULL), 0.0)
    good = use & (why == Unseen.SEEN)
    nothing = _core(image[:, :, None], fakes, width_px * _CORE[None, :])[:, 0]
    noise = window_noise(present, good, ways, nothing, gap_mm, known=False, even=True)
    return told_by_level(
        work, ways, use, image, present, np.asarray(why), noise, strange | passed, gap_mm, rate,
        log_step,
    )  # fmt: skip


def _changed(
    work: Working, places: Places, width_px: float, rng: np.random.Generator
) -> tuple[FloatImage, float] | None:
    """Image in which fresh ink is high and nothing 0, and the logarithm of ink's level.

    None where ink changes the level by no more than light and drying may.
    """
    level, light = light_less(work, places.ground, width_px)
    ground = BathNoise.of(level, places.ground, rng)
    rows = places.use & places.settled
    if ground is None or rows.sum() < _FEWEST:
        return None
    step = _usual_step(_core(level, places.seen, places.ways.width[:, None] * _CORE)[rows])
    least = _LEAST_STEP + _OF_LIGHT * float(np.abs(light[places.ground > 0]).max())
    if np.abs(step).max() < least:
        return None
    mix = channel_mix(level, ground, places.seen, places.ways.width, rows)
    mix = (mix * np.sign(step @ mix)).astype(np.float32)
    mixed = np.asarray((level - ground.mean.astype(np.float32)) @ mix, dtype=np.float32)
    return mixed, float(step[np.argmax(np.abs(step))])


def light_less(work: Working, ground: Mask, width_px: float) -> tuple[FloatImage, FloatImage]:
    """What changed beside the light, softened, and how the light did; each (h, w, c)."""
    raw = work.channels[:, :, work.channels.shape[2] // 2 :]
    light = _light(raw, ground)
    blur = max(0.6, _SOFT * width_px)
    soft = cv2.GaussianBlur(raw - light, (0, 0), blur).reshape(raw.shape)
    return np.asarray(soft, dtype=np.float32), light


def _light(raw: FloatImage, ground: Mask) -> FloatImage:
    """How the light changed, by the ground, (h, w, c): a surface of second order."""
    high, wide = ground.shape
    y, x = np.nonzero(ground)
    some = slice(None, None, max(1, len(x) // _MOST))
    y, x = y[some], x[some]
    basis = _powers(2.0 * x / wide - 1.0, 2.0 * y / high - 1.0)
    rows, columns = np.mgrid[0:high, 0:wide]
    whole = _powers(2.0 * columns.ravel() / wide - 1.0, 2.0 * rows.ravel() / high - 1.0)
    found = [whole @ _surface(basis, raw[y, x, c].astype(float)) for c in range(raw.shape[2])]
    return np.stack(found, axis=1).reshape(raw.shape).astype(np.float32)


def _powers(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])


def _surface(basis: FloatArray, values: FloatArray) -> FloatArray:
    """Terms (6,) by least squares with Huber's weights."""
    weight = np.ones(len(basis))
    terms: FloatArray = np.zeros(basis.shape[1])
    for _ in range(5):
        power = (basis.T * weight) @ basis + 1e-6 * len(basis) * np.eye(basis.shape[1])
        terms = np.asarray(np.linalg.solve(power, (basis.T * weight) @ values), dtype=np.float64)
        off = np.abs(values - basis @ terms)
        weight = np.minimum(1.0, 2.0 * float(np.median(off)) / np.maximum(off, 1e-12))
    return terms


def _core(image: FloatImage, seen: Seen, across: FloatArray) -> FloatArray:
    """Mean of each channel in the middle of lines, (n, c)."""
    parts = [
        seen.profiles(np.ascontiguousarray(image[:, :, c]), across).mean(axis=1)
        for c in range(image.shape[2])
    ]
    return np.stack(parts, axis=1).astype(np.float64)


def _usual_step(at: FloatArray) -> FloatArray:
    """Level (c,) that ink changes by; half of the places (n, c) may show none."""
    low, high = np.percentile(at, [100 - _HIGHEST, _HIGHEST], axis=0)
    step = np.where(np.abs(low) > np.abs(high), low, high)
    for _ in range(4):
        keep = np.abs(at @ step / max(float(step @ step), 1e-18) - 1.0) < 0.5
        if keep.sum() < _FEWEST:
            return np.asarray(np.median(at, axis=0))
        step = np.median(at[keep], axis=0)
    return np.asarray(step)


def _changed_alike(value: FloatArray, use: BoolArray, onto: IntArray) -> BoolArray:
    """Places on older ink of heights on which fresh ink changes about as much as anywhere, (n,).

    Opaque ink changes the level by the bath above older ink alone: much over deep ink, nothing
    where lines cross. Of each height half of the places may show none.
    """
    heights = [rows for one in np.unique(onto) if (rows := use & (onto == one)).any()]
    steps = [float(np.percentile(value[rows], _HIGHEST)) for rows in heights]
    out = np.zeros(len(value), dtype=np.bool_)
    for rows, step in zip(heights, steps, strict=True):
        if rows.sum() >= _FEWEST_ALIKE and step > _ALIKE * max(steps):
            out |= rows
    return out


def _ink_level(value: FloatArray, ways: Ways, use: BoolArray) -> FloatArray | None:
    """Change by sound ink at all places, (n,): a surface of second order through the usual ones.

    NaN where it is small; None where too few places show it.
    """
    if use.sum() < _FEWEST:
        return None
    point = ways.point[:, :2]
    x, y = (point - point.mean(axis=0)).T / max(float(np.ptp(point, axis=0).max()), 1e-6)
    basis = _powers(x, y)
    level = np.full(len(value), float(np.percentile(value[use], _HIGHEST)))
    near = use
    for terms in (1, 1, 3, 3, 6, 6):
        near = use & (level > 0) & (np.abs(value - level) < 0.5 * level)
        if near.sum() < max(_FEWEST, _LEAST_INK * use.sum()):
            return None
        a = basis[near, :terms]
        pull = 1e-3 * len(a) * np.eye(terms)
        pull[0, 0] = 0.0
        level = basis[:, :terms] @ np.linalg.solve(a.T @ a + pull, a.T @ value[near])
    return np.where(level > 0.3 * float(np.median(level[near])), level, np.nan)


def _still(places: Places, width_px: float) -> BoolArray:
    """What stood out from older ink before: a bubble, a speck; it may lie there still, (h, w)."""
    inside = _inside(places, width_px)
    if inside.sum() < _FEWEST:
        return np.zeros(inside.shape, dtype=np.bool_)
    shape = places.earlier.shape
    soft = cv2.GaussianBlur(places.earlier, (0, 0), max(0.6, _SOFT * width_px)).reshape(shape)
    ink = places.ink.astype(np.float32)[:, :, None]
    around = cv2.GaussianBlur(soft * ink, (0, 0), _AROUND * width_px).reshape(shape)
    share = cv2.GaussianBlur(ink, (0, 0), _AROUND * width_px).reshape(*shape[:2], 1)
    rest = soft - around / np.maximum(share, 1e-3)
    middle, spread = _usual(rest[inside])
    return grown((np.abs(rest - middle) > _STILL * spread).any(axis=2) & inside, width_px)


def _stands_out(places: Places) -> BoolArray:
    """Places along which the picture before differs from that of other older ink, (n,)."""
    level = _core(places.earlier, places.seen, places.ways.width[:, None] * _CORE)
    smooth = uniform_filter1d(level, _ALONG, axis=0, mode="nearest")
    middle, spread = _usual(smooth[places.use])
    return np.asarray((np.abs(smooth - middle) > _STILL_ALONG * spread).any(axis=1))


def _usual(values: FloatArray | FloatImage) -> tuple[FloatArray, FloatArray]:
    """Middle and spread of each channel, (c,)."""
    low, middle, high = np.percentile(values, [10, 50, 90], axis=0)
    return middle, np.maximum(middle - low, high - middle) / 1.2816 + 1e-3


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
    gaps: list[Gap],
    present: FloatArray,
    good: BoolArray,
    ways: Ways,
    changed: Callable[[BoolArray], float],
) -> tuple[list[Gap], BoolArray]:
    """Return gaps in which nothing changed, and the places of all others, (n,).

    ``changed`` is how much the picture did at some places (n,), over what ink does, whatever its
    level: ridges and their shades, too.
    """
    kept, doubtful = [], np.zeros(len(ways), dtype=np.bool_)
    for gap in gaps:
        own = (ways.stroke == gap.stroke) & (ways.along >= gap.from_mm) & (ways.along <= gap.to_mm)
        inner = present[own & good]
        long = gap.length_mm > _SHORTEST * float(ways.width[own].max(initial=0.0))
        same = len(inner) > 0 and float(np.median(np.abs(inner))) < _UNCHANGED
        share = changed(own) if long and same else np.inf
        if share < _MUCH:
            kept.append(replace(gap, shaded=share > _SHADED))
        else:
            doubtful |= own
    return kept, doubtful
