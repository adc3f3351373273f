"""Learn ink over one background (bath or older ink), and measure its presence along lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.directions import untold
from registration.inspection.ink.in_light import in_light
from registration.inspection.ink.ink_image import (
    ACROSS,
    WITHIN,
    BathNoise,
    Template,
    angle_of,
    learn_template,
    mixes_of,
)
from registration.inspection.ink.line_levels import among_lines, line_levels
from registration.inspection.ink.place_reasons import reasons
from registration.inspection.ink.presence import (
    Sides,
    WindowNoise,
    fake_places,
    long_bath,
    presence,
    rougher,
    window_noise,
    without_lows,
)
from registration.inspection.ink.rims import rim_presence, rim_share, shows_rim
from registration.inspection.ink.seams import SeamLevels, is_disturbed, seam_levels
from registration.inspection.ink.short_lines import SHORT, short_noise
from registration.inspection.ink.strange import grown, strange_places, strangeness, unlike_bath
from registration.inspection.pictures.working import Mask, Working
from registration.inspection.values import Appearance, FloatImage, Unseen
from registration.inspection.ways import Seen, Ways

_MOST_SATURATED = 0.3
"""Of the lines: more, and it is the ink that is saturated."""
_INK_SATURATED, _MORE_OFTEN = 0.05, 4.0
"""Share of the lines, and how many times that of the bath: then it is bright ink, not glare."""
_FEWEST = 10
_PLENTY = 15.0
"""A contrast from which on no other mix of the channels is tried."""
LONG = 6.0
"""Tolerated gaps: a length of which one must be told, for a look to be worth anything."""
_FEW_ALONE, _LEAST_ALONE = 60, 0.05
"""Places without another line over them, and their share, to learn from them alone."""
_WEAK = 0.4
"""Of the usual strength: lines along the light that ridges are told by aren't seen."""
_SHOWN = 0.5
"""Of its known level, below which lines aren't what ink looks like."""
_EVEN = 0.05
"""Least scatter beside lines in a map of heights, thicknesses: else a line's foot is strange."""


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
    contrast : float
        Ink over background, in standard deviations of a place as long as a tolerated gap.
    strange : (h, w) bool
    unlike_bath : (h, w) float32
        Above 1 where it surely is neither bath nor on the way to ink.
    appearance : Appearance
    bath_spread : float
        Of a place's level in the image, at a single place across.
    log_step : float
        Logarithm of ink's brightness over the bath's; 0 where the picture isn't in logarithms.
    ink : (c,) float64
        Level of ink over the background in each channel.
    faint : bool
        Whether a gap that is just tolerated might be missed; longer ones may still be told.
    level : (n,) float64
        Presence of each place's own line, by which ``present`` was divided.
    strength : (n,) float64
        Of what shows a line there, over the usual, at most 1: noise is as much larger.
    shaded : bool
        Whether by the shading of ridges, drawn at each place (`told_by_ridges`).
    seams : SeamLevels or None
        Ink between lines that touch; None where nothing tells of it.
    """

    image: FloatImage
    profiles: FloatImage
    present: FloatArray
    plain: FloatArray
    why: IntArray
    template: Template
    noise: WindowNoise | None
    contrast: float
    strange: BoolArray
    unlike_bath: FloatImage
    appearance: Appearance
    bath_spread: float
    log_step: float
    ink: FloatArray
    faint: bool
    level: FloatArray
    strength: FloatArray
    shaded: bool = False
    seams: SeamLevels | None = None

    @property
    def scatter_step(self) -> float:
        """The same as ``log_step`` of a picture that is a logarithm itself, of one channel."""
        return float(np.clip(self.template.scale / self.appearance.mix[0], -3.0, 3.0))


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
    tolerance : float
        Share of its ink that a line may lack.
    """

    smooth: FloatImage
    flat: FloatImage
    free: Mask
    fresh: Mask
    work: Working
    gap_mm: float
    rate: float
    known: Appearance | None
    tolerance: float = 0.15


def tell_ink(
    ground: Ground, ways: Ways, seen: Seen, sides: Sides, use: BoolArray, rng: np.random.Generator
) -> Told | None:
    """Judge places ``use`` (n,) against their background; None where there is none to be seen."""
    bath = BathNoise.of(ground.smooth, ground.free, rng)
    if bath is None or not use.any():
        return None
    if ground.work.height is not None:
        bath = bath.widened(_EVEN)
    known = ground.known if _fits(ground.known, ground.flat.shape[2]) else None
    alone = _alone(ways, use)
    mixes = [known.mix] if known else mixes_of(ground.smooth, bath, seen, ways.width, alone)
    ink = _ink_levels(ground.smooth, bath, seen, alone)
    if known and abs(known.mix @ ink) < _SHOWN * abs(known.mix @ known.ink):
        ink = known.ink  # hardly any lies there
    best: Told | None = None
    for mix in mixes:
        told = _by_mix(mix, ink, bath, known, ground, ways, seen, sides, use, rng)
        if told is not None and (best is None or told.contrast > 1.2 * best.contrast):
            best = told
        if best is not None and best.contrast > _PLENTY:
            break
    return best


def _by_mix(
    mix: FloatArray,
    ink: FloatArray,
    bath: BathNoise,
    known: Appearance | None,
    ground: Ground,
    ways: Ways,
    seen: Seen,
    sides: Sides,
    use: BoolArray,
    rng: np.random.Generator,
) -> Told | None:
    mixed = np.asarray(ground.flat @ mix.astype(np.float32) - np.float32(bath.mean @ mix))
    width_px = float(np.median(ways.width)) * ground.work.px_per_mm
    among = among_lines(ground.smooth, ways, seen, use) if ways.varied else None
    profiles, angle = seen.profiles(mixed, ways.width[:, None] * ACROSS), angle_of(seen)
    rim = _rim(profiles, angle, sides, use, ink) if ground.work.is_scatter else None
    away = strangeness(ground.smooth, bath, ink, ground.work.is_log, among, rim)
    strange = strange_in(ground, away, width_px, bool(ink.sum() > 0))
    why = reasons(ground.work, seen, ways, strange)
    learn = _alone(ways, use & (why == Unseen.SEEN))
    if learn.sum() < _FEWEST and known is None:
        return None
    if known:
        template = _known_template(known)
    else:
        template = learn_template(profiles[learn], sides.usable()[learn], angle[learn])
        template = template if ground.work.is_log else template.even
    scale = np.float32(template.scale)
    image = np.asarray(mixed / scale, dtype=np.float32)
    profiles = profiles / scale
    free = ((ground.free > 0) & ~strange).astype(np.uint8)
    fakes = _fake_profiles(image, free, ground.work.px_per_mm, width_px, ways, rng)
    texture = not template.filled and fakes is not None
    noise_across = np.cov(fakes[0][::4].T) if texture and fakes is not None else None
    weights, strength = template.weights(angle, noise_across)
    why[(why == Unseen.SEEN) & (strength < _WEAK * np.percentile(strength, 90))] = int(Unseen.FAINT)
    left, right = sides.levels(profiles, ways.width * ground.work.px_per_mm)
    present, plain = presence(profiles, weights, left, right)
    fake_present, bath_spread = None, 0.0
    if fakes is not None:
        own, _ = template.weights(fakes[1], noise_across)
        fake_present = (fakes[0] * own).sum(axis=1).astype(np.float64)
    if ground.work.is_scatter and shows_rim(template):
        rims = rim_presence(profiles, template)
        present, plain = np.maximum(present, rims), np.maximum(plain, rims)
        if fakes is not None and fake_present is not None:
            fake_present = np.maximum(fake_present, rim_presence(fakes[0], template))
    least, level = 1.0, np.ones(len(ways))
    if ways.varied:
        level = line_levels(plain, ways, use & (why == Unseen.SEEN), fake_present)
        profiles = np.asarray(profiles / level[:, None], dtype=np.float32)
        present, plain = present / level, plain / level
        least = float(level.min())
        fake_present = None if fake_present is None else fake_present / least
    if fakes is not None:
        inner = fakes[0][:, WITHIN]
        bath_spread = 1.4826 * float(np.median(np.abs(inner - np.median(inner))))
    why[(why == Unseen.SEEN) & untold(template, sides, ways, angle, present)] = int(Unseen.FAINT)
    good = use & (why == Unseen.SEEN)
    log_step, seams = _log_step(mix, ink, ground.work.is_log), None
    if ground.work.is_log and template.filled:
        evened = np.asarray(ground.smooth @ mix - bath.mean @ mix, np.float32) / scale
        odd = is_disturbed(evened, ground.free, strange | ground.work.bad)
        light = in_light(profiles, log_step)
        seams = seam_levels(light, good, ways, template.slant, ground.tolerance, odd)
    sound = good if seams is None else good & ~seams.near(ways)  # thin ink is no scatter
    over_long = partial(
        long_bath, image, free, LONG * ground.gap_mm, ground.work.px_per_mm, width_px, template,
        least, rng,
    )  # fmt: skip
    noise, contrast, faint = sureness(
        present, sound, ways, fake_present, ground, known is not None, template, over_long
    )
    look = Appearance(mix, template.terms * template.scale, template.filled, ink)
    return Told(
        image, profiles, present, plain, why, template, noise, contrast, strange,
        unlike_bath(away, ground.free), look, bath_spread,
        log_step, ink, faint, level, np.ones(len(ways)), seams=seams,
    )  # fmt: skip


def _rim(
    profiles: FloatImage, angle: FloatArray, sides: Sides, use: BoolArray, ink: FloatArray
) -> FloatArray:
    """Levels of the rim that a scan's filaments show about a middle of the other sign, (c,)."""
    return -rim_share(learn_template(profiles[use], sides.usable()[use], angle[use])) * ink


def sureness(
    present: FloatArray,
    good: BoolArray,
    ways: Ways,
    bath: FloatArray | None,
    ground: Ground,
    known: bool,
    template: Template,
    over_long: Callable[[], tuple[float, float]],
) -> tuple[WindowNoise | None, float, bool]:
    """`Told.noise`, ``contrast`` and ``faint`` of places; ``over_long`` is bath's scatter there."""

    def scatter(places: BoolArray) -> WindowNoise | None:
        alone = _alone(ways, places)
        return window_noise(
            present, alone, ways, bath, ground.gap_mm, known, template.by_edges,
            by_size=ground.work.flanks_lost and template.filled,
        )  # fmt: skip

    noise, way_mm = scatter(good), float(ways.step[good].sum())
    gap_mm, long_mm = ground.gap_mm, LONG * ground.gap_mm
    needed = ground.rate / max(1.0, way_mm / gap_mm)
    if template.filled and bath is not None and way_mm < SHORT * gap_mm:
        if noise is None or not noise.can_tell(gap_mm, needed):
            noise = short_noise(present, good, ways, bath, gap_mm) or noise
        long_mm = max(2.0 * gap_mm, min(long_mm, 0.5 * way_mm))
    if noise is None:
        return None, 0.0, True
    contrast = noise.contrast(gap_mm)
    if noise.can_tell(gap_mm, needed):
        return noise, contrast, False
    if template.one_sided or template.by_edges:
        return None, contrast, True
    if bath is not None:
        sure = without_lows(present, good, ways, noise.middle, 0.5 * LONG * gap_mm)
        long = replace(scatter(sure) or noise, bath_long=over_long())
        noise = long.at_least(rougher(present, good, ways, bath, gap_mm))
    return (noise if noise.can_tell(long_mm, needed) else None), contrast, True


def _alone(ways: Ways, use: BoolArray) -> BoolArray:
    """Places over which no other line lies; all where too few of them are left."""
    alone = use & ~ways.crossed
    return alone if alone.sum() > max(_FEW_ALONE, _LEAST_ALONE * use.sum()) else use


def _fits(known: Appearance | None, channels: int) -> bool:
    return known is not None and len(known.mix) == channels


def _known_template(known: Appearance) -> Template:
    flat = known.terms[:, WITHIN].ravel()
    scale = float(flat[np.argmax(np.abs(flat))])
    return Template(known.terms / scale, scale, known.filled)


def _ink_levels(smooth: FloatImage, bath: BathNoise, seen: Seen, use: BoolArray) -> FloatArray:
    """Ink less bath of each channel in the middle of lines, (c,)."""
    middle = np.zeros((1, 1))
    out = np.zeros(smooth.shape[2])
    for c in range(len(out)):
        level = seen.profiles(np.ascontiguousarray(smooth[:, :, c]), middle)[use, 0]
        out[c] = _ink_level(level - bath.mean[c], float(np.sqrt(bath.covariance[c, c])))
    return out


def _log_step(mix: FloatArray, ink: FloatArray, is_log: bool) -> float:
    """Logarithm of ink's brightness over the bath's, by the weights of the channels; 0: none."""
    weight = np.abs(mix * ink)
    if not is_log or weight.sum() <= 0:
        return 0.0
    return float(np.clip(weight @ ink / weight.sum(), -3.0, 3.0))


def strange_in(ground: Ground, away: FloatImage, width_px: float, is_bright: bool) -> BoolArray:
    """Where neither ink nor bath is seen, (h, w): glints, too, unless bright ink saturates."""
    found = strange_places(away, ground.free, ground.fresh, width_px)
    saturated = ground.work.bad
    lines = ground.fresh > 0
    on, off = (_share(saturated, mask) for mask in (lines, ~lines))
    of_ink = on > _INK_SATURATED and on > _MORE_OFTEN * off
    if not (is_bright and (of_ink or on >= _MOST_SATURATED)):
        found = found | grown(saturated, width_px)
    return found


def _share(flags: BoolArray, where: BoolArray) -> float:
    return float(flags[where].mean()) if where.any() else 0.0


def _ink_level(level: FloatArray, spread: float) -> float:
    """Level of ink where a part of the places may show none."""
    usual = float(np.median(level))
    low, high = np.percentile(level, [10, 90])
    far = float(low if abs(low) > abs(high) else high)
    return usual if abs(usual) > 0.5 * abs(far) or abs(far) < spread else far


def _fake_profiles(
    image: FloatImage,
    free: Mask,
    px_per_mm: float,
    width_px: float,
    ways: Ways,
    rng: np.random.Generator,
) -> tuple[FloatImage, FloatArray] | None:
    """Profiles where there is bath alone (8 places a line), and their directions."""
    step_px = float(np.median(ways.step)) * px_per_mm
    fakes = fake_places(free, width_px, step_px, rng)
    if fakes is None:
        return None
    return fakes.profiles(image, width_px * ACROSS[None, :]), angle_of(fakes)
