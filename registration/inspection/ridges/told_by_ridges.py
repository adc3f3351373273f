"""Measure presence of ridges lit from the side against the shading expected at each place.

The shading of a line beside a turn, or between neighbours that touch it, isn't that of a line that
stands alone. With the light known (`ridge_shading`) the picture of beads that run into each other
is drawn for each place twice, with its line and without, and presence is what the picture shows of
the difference: a matched filter of its own at every place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_image import ACROSS, WITHIN, BathNoise, Template
from registration.inspection.ink.place_reasons import reasons
from registration.inspection.ink.presence import INK, fake_places, long_bath, spread_of
from registration.inspection.ink.strange import strangeness, unlike_bath
from registration.inspection.ink.told import LONG, Ground, Told, strange_in, sureness
from registration.inspection.ridges.ridge_axes import Stretch
from registration.inspection.ridges.ridge_shading import RidgeLight
from registration.inspection.values import Appearance, FloatImage, Unseen
from registration.inspection.ways import Seen, Ways

_WEAK: Final = 0.45
"""Of the usual strength: lines that shading shows so faintly aren't told."""
_RIDGE: Final = 0.3
_UNLEARNED: Final = 2.5
"""Times the usual scatter, near turns, where too few of them are seen to learn it."""
_AT_TURN: Final = 0.6
"""Widths from a turn, within which beads that meet scatter more."""
_DRAWN_BESIDE: Final = 2.0
"""Widths beyond a gap, by which a turn may lie away and yet change what is drawn."""
_EACH: Final = 4
"""Of the places along straight ways, that is drawn."""
_FEWEST: Final = 16
_FEW: Final = 5.0
"""Spreads of n places are widened by 1 + 5 / n."""


def tell_ridges(
    light: RidgeLight,
    ground: Ground,
    ways: Ways,
    seen: Seen,
    use: BoolArray,
    usual: Told,
    rng: np.random.Generator,
) -> Told:
    """Return ink over the bath by its shading, at places ``use`` (n,).

    ``usual`` is the same by a symmetric look.
    """
    terms = light.across()
    scale = float(np.sqrt((terms[1:] ** 2).sum(axis=0)).max())
    mean = ground.flat[:, :, light.channels].mean(axis=2) - np.float32(light.level)
    image = np.ascontiguousarray(mean / np.float32(scale), dtype=np.float32)
    profiles = seen.profiles(image, ways.width[:, None] * ACROSS)
    with_it, without = (one / scale for one in _drawn(light, ways, ground.gap_mm))
    missing = with_it - without
    width_px = float(np.median(ways.width)) * ground.work.px_per_mm
    step_px = float(np.median(ways.step)) * ground.work.px_per_mm
    fakes = fake_places(ground.free, width_px, step_px, rng)
    bath = None if fakes is None else fakes.profiles(image, width_px * ACROSS[None, :])[:, WITHIN]
    weights: FloatArray = missing
    if bath is not None:
        noise = np.cov(bath[::4].T)
        ridge = _RIDGE * float(np.trace(noise)) / len(noise)
        weights = np.asarray(
            np.linalg.solve(noise + ridge * np.eye(len(noise)), missing.T).T, dtype=np.float64
        )
    power = np.maximum((missing * weights).sum(axis=1), 1e-12)
    present = ((profiles[:, WITHIN] - without) * weights).sum(axis=1) / power
    strength = np.sqrt(power)
    away = _strangeness(ground, scale, rng)
    strange = strange_in(ground, away, width_px, False)
    why = reasons(ground.work, seen, ways, strange)
    usable = use & (why == Unseen.SEEN)
    common = float(np.percentile(strength[usable], 75)) if usable.any() else 1.0
    share = np.minimum(strength / common, 1.0)
    why[(why == Unseen.SEEN) & (share < _WEAK)] = int(Unseen.FAINT)
    good = use & (why == Unseen.SEEN)
    fake_present = None
    if bath is not None:
        pick = rng.choice(np.flatnonzero(good if good.any() else use), len(bath) // 8).repeat(8)
        fake_present = (bath * weights[pick]).sum(axis=1) / power[pick] * share[pick]
    # Noise is as much stronger as shading is weaker: evened, all places scatter alike.
    share = share / _rougher_turns(1.0 + (present - 1.0) * share, good & (present > INK), ways)
    evened = 1.0 + (present - 1.0) * share
    template = Template(terms / scale, scale, False, light.slant)
    over_long = partial(
        long_bath, image, ground.free, LONG * ground.gap_mm, ground.work.px_per_mm, width_px,
        template, 1.0, rng,
    )  # fmt: skip
    noise_found, contrast, faint = sureness(
        evened, good, ways, fake_present, ground, False, template, over_long
    )
    count = ground.flat.shape[2]
    mix = np.zeros(count)
    mix[light.channels] = 1.0 / len(mix[light.channels])
    return replace(
        usual, image=image, profiles=profiles, present=present, plain=present, why=why,
        template=template, noise=noise_found, contrast=contrast, faint=faint,
        appearance=Appearance(mix, terms, False, np.zeros(count)), log_step=0.0,
        level=np.ones(len(ways)), strength=share, shaded=True, seams=None, strange=strange,
        unlike_bath=unlike_bath(away, ground.free),
    )  # fmt: skip


def _rougher_turns(evened: FloatArray, ink: BoolArray, ways: Ways) -> FloatArray:
    """Return how much more presence scatters at places near turns than elsewhere, (n,); 1 or more.

    Creases where beads meet are smoothed by blur and by ink's surface tension, as no line is.
    """
    turns = ways.corners(_AT_TURN)
    near, far = (evened[ink & one] for one in (turns, ~turns))
    ratio = _UNLEARNED
    if min(len(near), len(far)) >= _FEWEST:
        ratio = spread_of(near) * (1.0 + _FEW / len(near)) / max(spread_of(far), 1e-9)
    return np.where(turns, max(ratio, 1.0), 1.0)


def _strangeness(ground: Ground, scale: float, rng: np.random.Generator) -> FloatImage:
    """`strangeness` where ridges may be brighter and darker than the bath, (h, w)."""
    bath = BathNoise.of(ground.smooth, ground.free, rng)
    assert bath is not None  # or there would be no usual look
    flank = np.full(ground.smooth.shape[2], scale)
    both = (strangeness(ground.smooth, bath, way * flank, True) for way in (1.0, -1.0))
    return np.asarray(np.minimum(*both))


def _drawn(light: RidgeLight, ways: Ways, gap_mm: float) -> tuple[FloatArray, FloatArray]:
    """Shading across all places with their line and without a stretch of it, (n, 21) each.

    Along straight ways it hardly changes: some places are drawn there, and those between follow.
    """
    reach = gap_mm / light.width_mm + _DRAWN_BESIDE
    number = np.arange(len(ways))
    end = np.diff(ways.run, prepend=-1, append=-1) != 0
    own = ways.corners(reach) | ways.crossed | end[:-1] | end[1:] | (number % _EACH == 0)
    rows = np.flatnonzero(own)
    after = np.minimum(np.searchsorted(rows, number), len(rows) - 1)
    before = np.maximum(after - (rows[after] > number), 0)
    part = (number - rows[before]) / np.maximum(rows[after] - rows[before], 1)
    with_it, without = (
        one[before] + part[:, None] * (one[after] - one[before])
        for one in _drawn_at(rows, light, ways, gap_mm)
    )
    return with_it, without


def _drawn_at(
    rows: IntArray, light: RidgeLight, ways: Ways, gap_mm: float
) -> tuple[FloatArray, FloatArray]:
    count = int(WITHIN.sum())
    across = (ways.width[rows, None] * ACROSS[WITHIN])[:, :, None] * ways.normal[rows, None, :]
    at = (ways.point[rows, None, :2] + across).reshape(-1, 2)
    stroke, along = np.repeat(ways.stroke[rows], count), np.repeat(ways.along[rows], count)
    apart = 0.5 * (gap_mm + light.width_mm)
    with_it, without = (
        light.shade(at, Stretch(stroke, along, half)).reshape(-1, count) for half in (0.0, apart)
    )
    return with_it, without
