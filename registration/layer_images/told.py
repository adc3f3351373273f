"""Tell ink from one kind of background (bath, or older ink) at all places over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from registration.layer_images.ink_image import (
    ACROSS,
    WITHIN,
    BathNoise,
    Template,
    channel_mix,
    learn_template,
)
from registration.layer_images.presence import (
    Sides,
    WindowNoise,
    fake_places,
    presence,
    window_noise,
)
from registration.layer_images.strange import grown, strange_places
from registration.layer_images.values import Appearance, BoolArray, FloatArray, FloatImage, Unseen
from registration.layer_images.ways import Seen, Ways
from registration.layer_images.working import Mask, Working

_MOST_SATURATED = 0.3
"""Of the lines: more, and it is the ink that is saturated."""
_HIT = 0.2
"""Of a place's width that must be strange for it not to be seen."""


@dataclass(frozen=True)
class Told:
    """Ink over one background.

    Attributes
    ----------
    image : (h, w) float32
        Background 0, ink 1.
    profiles : (n, 61) float32
        Of it, across all places.
    present : (n,) float64
        Presence; ink 1, background 0.
    plain : (n,) float64
        The same by the profile alone.
    why : (n,) int64
        `Unseen`.
    template : Template
    noise : WindowNoise or None
        None where ink can't be told from this background.
    strange : (h, w) bool
    appearance : Appearance
    bath_spread : float
        Of a place's level in the image, at a single place across.
    """

    image: FloatImage
    profiles: FloatImage
    present: FloatArray
    plain: FloatArray
    why: FloatArray
    template: Template
    noise: WindowNoise | None
    strange: BoolArray
    appearance: Appearance
    bath_spread: float


@dataclass(frozen=True)
class Ground:
    """What places are judged against.

    Attributes
    ----------
    smooth, flat : (h, w, c) float32
        Channels without light, smoothed and not.
    free : (h, w) uint8
        Background alone.
    fresh : (h, w) uint8
    work : Working
    gap_mm : float, mm
    rate : float
        False findings per sound layer.
    known : Appearance or None
    """

    smooth: FloatImage
    flat: FloatImage
    free: Mask
    fresh: Mask
    work: Working
    gap_mm: float
    rate: float
    known: Appearance | None


def tell_ink(
    ground: Ground, ways: Ways, seen: Seen, sides: Sides, use: BoolArray, rng: np.random.Generator
) -> Told | None:
    """Judge places ``use`` (n,) against their background; None where there is none to be seen."""
    bath = BathNoise.of(ground.smooth, ground.free, rng)
    if bath is None or not use.any():
        return None
    known = ground.known if _fits(ground.known, ground.flat.shape[2]) else None
    mix = known.mix if known else channel_mix(ground.smooth, bath, seen, ways.width, use)
    mixed = np.asarray(ground.flat @ mix.astype(np.float32) - np.float32(bath.mean @ mix))
    width_px = float(np.median(ways.width)) * ground.work.px_per_mm
    strange = _strange(ground, bath, seen, ways, use, width_px)
    across = ways.width[:, None] * ACROSS
    profiles = seen.profiles(mixed, across)
    why = _reasons(ground.work, seen, ways, strange)
    usable = sides.usable()
    learn = use & (why == Unseen.SEEN)
    if learn.sum() < 20 and known is None:
        return None
    template = _known_template(known) if known else learn_template(profiles[learn], usable[learn])
    image, profiles = mixed / np.float32(template.scale), profiles / np.float32(template.scale)
    px_width = ways.width * ground.work.px_per_mm
    left, right = sides.levels(profiles, px_width)
    plain = np.asarray(profiles @ template.weight, dtype=np.float64)
    present = presence(profiles, template, left, right)
    fakes, bath_spread = _fake_presence(image, ground, template, width_px, ways, rng)
    good = use & (why == Unseen.SEEN)
    noise = window_noise(present, good, ways, fakes, ground.gap_mm)
    if noise is not None:
        places = max(1.0, float(ways.step[good].sum()) / ground.gap_mm)
        if not noise.can_tell(ground.gap_mm, ground.rate / places):
            noise = None
    core = float(template.values[np.abs(ACROSS) < 0.15].mean())
    look = Appearance(mix, template.values * template.scale, core * template.scale)
    return Told(
        image, profiles, present, plain, why, template, noise, strange, look, bath_spread
    )  # fmt: skip


def _fits(known: Appearance | None, channels: int) -> bool:
    return known is not None and len(known.mix) == channels


def _known_template(known: Appearance) -> Template:
    scale = float(known.template[np.argmax(np.abs(np.where(WITHIN, known.template, 0.0)))])
    return Template(known.template / scale, scale, known.core / scale > 0.6)


def _strange(
    ground: Ground, bath: BathNoise, seen: Seen, ways: Ways, use: BoolArray, width_px: float
) -> BoolArray:
    ink = np.zeros(ground.smooth.shape[2])
    for c in range(len(ink)):
        level = seen.profiles(
            np.ascontiguousarray(ground.smooth[:, :, c]), ways.width[:, None] * np.zeros((1, 1))
        )[use, 0]
        ink[c] = _ink_level(level - bath.mean[c], float(np.sqrt(bath.covariance[c, c])))
    found = strange_places(ground.smooth, bath, ink, ground.free, ground.fresh, width_px)
    saturated = ground.work.bad
    lines = ground.fresh > 0
    if lines.any() and saturated[lines].mean() < _MOST_SATURATED:
        found = found | grown(saturated, width_px)
    return found


def _ink_level(level: FloatArray, spread: float) -> float:
    """Level of ink where a part of the places may show none."""
    usual = float(np.median(level))
    low, high = np.percentile(level, [10, 90])
    far = float(low if abs(low) > abs(high) else high)
    return usual if abs(usual) > 0.5 * abs(far) or abs(far) < spread else far


def _reasons(work: Working, seen: Seen, ways: Ways, strange: BoolArray) -> FloatArray:
    """Why each place isn't seen, (n,)."""
    across = ways.width[:, None] * np.linspace(-0.5, 0.5, 9)
    why = np.full(len(ways), int(Unseen.SEEN))
    for mask, reason in ((strange, Unseen.GLARE), (work.hidden, Unseen.HIDDEN)):
        hit = seen.profiles(mask.astype(np.uint8), across, nearest=True).mean(axis=1)
        why[hit > _HIT] = int(reason)
    why[~seen.inside(work.shape, 0.5 * ways.width)] = int(Unseen.OUTSIDE)
    return np.asarray(why)


def _fake_presence(
    image: FloatImage,
    ground: Ground,
    template: Template,
    width_px: float,
    ways: Ways,
    rng: np.random.Generator,
) -> tuple[FloatArray | None, float]:
    """Presence where there is bath alone (8 places a line), and the scatter of single values."""
    step_px = float(np.median(ways.step)) * ground.work.px_per_mm
    fakes = fake_places(ground.free, width_px, step_px, rng)
    if fakes is None:
        return None, 0.0
    profiles = fakes.profiles(image, width_px * ACROSS[None, :])
    inner = profiles[:, WITHIN]
    middle = float(np.median(inner))
    return (
        np.asarray(profiles @ template.weight, dtype=np.float64),
        1.4826 * float(np.median(np.abs(inner - middle))),
    )
