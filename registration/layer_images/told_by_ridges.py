"""Measure presence of ridges lit from the side against the shading expected at each place.

The shading of a line beside a turn, or between neighbours that touch it, isn't that of a line that
stands alone. With the light known (`ridge_light`) the picture of beads that run into each other is
drawn for each place twice, with its line and without, and presence is what the picture shows of
the difference: a matched filter of its own at every place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from registration.layer_images.ink_image import ACROSS, WITHIN, Template
from registration.layer_images.place_reasons import reasons
from registration.layer_images.presence import fake_places, long_bath
from registration.layer_images.ridge_light import RidgeLight
from registration.layer_images.told import LONG, Ground, Told, sureness
from registration.layer_images.values import (
    Appearance,
    BoolArray,
    FloatArray,
    Unseen,
)
from registration.layer_images.ways import Seen, Ways

_WEAK: Final = 0.45
"""Of the usual strength: lines that shading shows so faintly aren't told."""
_RIDGE: Final = 0.3


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

    ``usual`` is the same by a symmetric look, from which what is strange in the picture is taken.
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
    weights = missing
    if bath is not None:
        noise = np.cov(bath[::4].T)
        ridge = _RIDGE * float(np.trace(noise)) / len(noise)
        weights = np.linalg.solve(noise + ridge * np.eye(len(noise)), missing.T).T
    power = np.maximum((missing * weights).sum(axis=1), 1e-12)
    present = ((profiles[:, WITHIN] - without) * weights).sum(axis=1) / power
    strength = np.sqrt(power)
    why = reasons(ground.work, seen, ways, usual.strange)
    usable = use & (why == Unseen.SEEN)
    common = float(np.percentile(strength[usable], 75)) if usable.any() else 1.0
    share = np.minimum(strength / common, 1.0)
    # Noise is as much stronger as shading is weaker: evened, all places scatter alike.
    present = 1.0 + (present - 1.0) * share
    why[(why == Unseen.SEEN) & (share < _WEAK)] = int(Unseen.FAINT)
    good = use & (why == Unseen.SEEN)
    fake_present = None
    if bath is not None:
        pick = rng.choice(np.flatnonzero(good if good.any() else use), len(bath) // 8).repeat(8)
        fake_present = (bath * weights[pick]).sum(axis=1) / power[pick] * share[pick]
    template = Template(terms / scale, scale, False, light.slant)
    over_long = partial(
        long_bath, image, ground.free, LONG * ground.gap_mm, ground.work.px_per_mm, width_px,
        template, 1.0, rng,
    )  # fmt: skip
    noise_found, contrast, faint = sureness(
        present, good, ways, fake_present, ground, False, template, over_long
    )
    count = ground.flat.shape[2]
    mix = np.zeros(count)
    mix[light.channels] = 1.0 / len(mix[light.channels])
    return replace(
        usual, image=image, profiles=profiles, present=present, plain=present, why=why,
        template=template, noise=noise_found, contrast=contrast, faint=faint,
        appearance=Appearance(mix, terms, False, usual.ink), log_step=0.0,
        level=np.ones(len(ways)),
    )  # fmt: skip


def _drawn(light: RidgeLight, ways: Ways, gap_mm: float) -> tuple[FloatArray, FloatArray]:
    """Shading across all places with their line and without a stretch of it, (n, 21) each."""
    count = int(WITHIN.sum())
    across = (ways.width[:, None] * ACROSS[WITHIN])[:, :, None] * ways.normal[:, None, :]
    at = (ways.point[:, None, :2] + across).reshape(-1, 2)
    stroke, along = (np.repeat(one, count) for one in (ways.stroke, ways.along))
    within = 0.75 * light.width_mm
    apart = 0.5 * (gap_mm + light.width_mm)
    near = light.axes.nearest(at, within)
    other = light.axes.nearest_other(at, stroke, along, apart, within)
    with_it, without = (light.shade(*one).reshape(-1, count) for one in (near, other))
    return with_it, without
