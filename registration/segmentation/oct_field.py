"""Compute an OCT scan's gel field: noise, attenuation, walls and local levels corrected.

Four things decide whether a wall comes out where it is, and each is taken away:

- light fades on its way down and is brighter below lumens (`light`);
- an A-scan that a steep wall fills in part has no light of its own to be held against: gel and
  liquid beside it have (`walls`);
- what is left of both, and the instrument's roll-off, changes slowly: gel and liquid have local
  levels, taken well inside of either (`local_level`);
- the surface lies halfway between these two, not halfway to nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from registration.errors import SegmentationError
from registration.scan import Scan
from registration.segmentation.bright_liquid import (
    TwoMedia,
    liquid_is_dark,
    sides_of,
    two_media,
)
from registration.segmentation.even_light import even_signal, without_glare
from registration.segmentation.filters import bin_mean, normalise
from registration.segmentation.light import remaining_light, share_of_gel
from registration.segmentation.local_level import local_level
from registration.segmentation.reflections import without_lines
from registration.segmentation.response import depth_response
from registration.segmentation.unevenness import unevenness
from registration.segmentation.volume import GelField, Strength
from registration.segmentation.walls import Sides, share_of_volume
from registration.segmentation.working import Working, probe

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]

GEL_MM, LIQUID_MM = 0.25, 0.15
"""Levels are averaged over about this distance; the liquid's changes faster outside the gel."""
COARSE_MM = 0.09
"""Averages are taken on a grid no finer than this."""
LEAST_CONTRAST = 3.0
"""Distance of gel and liquid, in standard deviations of the gel."""
GROWTH = 1.15
"""What grows brighter by more over `GROWTH_MM` of depth is seen from below; a focus within the gel
does less."""
GROWTH_MM = 0.3
FLOOR_BLOCK = 4
BRIGHT = 0.25
"""Above this part of the brightest, gel is meant."""
BRIGHTEST = 1.5
"""No voxel counts as more gel: what is left of lines, on rough and slanting walls, weighs less."""
UNSEEN_LINE = 0.5
"""Of the scan's own depth voxel: the most that a reflection no brighter than gel adds to it at a
wall, which is half gel already. Rough walls have ledges that send light back whichever way they
stand; walls that face the light or away from it send back as much again."""
QUIET = 6.0
"""Distance of gel and liquid, in standard deviations of the gel, from which on no more smoothing
helps: half of it is 3, by which no speckle of a section's middle passes for gel."""
SOFTEST = 2.0
"""Times the usual smoothing, at most: more leaves nothing of a lumen."""
DAZZLE = 1.15
"""Nor is it brighter than this, once its speckle is smoothed."""


def oct_field(scan: Scan, working: Working) -> tuple[GelField, float, Strength]:
    """Compute an OCT volume's gel field, its contrast, and the light that came back.

    Raises
    ------
    SegmentationError
        When gel and liquid can't be told apart.
    """
    signal = working.binned(scan)
    noise = _noise_floor(signal, working.bins)
    signal -= np.float32(noise)
    step = float(working.voxel_mm[2])
    dull = without_glare(signal, step)
    _refuse_upside_down(dull, step, scan.depth_down)
    response = depth_response(dull, noise, working, scan.depth_down)[:, None, None]
    signal /= response
    dull /= response
    light, typical = remaining_light(dull, step, 3 * noise, working.voxel_mm[:2], scan.depth_down)
    light *= np.float32(typical)
    light = even_signal(dull, light, working)
    both = None
    if not liquid_is_dark(dull, light, noise / response):
        both = _two_media(dull * response + np.float32(noise), working, scan.depth_down)
    if both is None:
        sides, bright = _sides(dull, light), 0.0
        _, fy, fx = _coarse(working, signal)
        share, known = share_of_volume(signal, light, sides, working, (1, fy, fx))
        signal *= response  # as it came back, to be held against the noise
    else:
        sides, bright = both.sides, both.liquid
        signal *= response
        raw = signal + np.float32(noise)  # the floor may be bright liquid's
        share, known = _share_of_step(raw, both), np.ones(signal.shape, dtype=np.bool_)
        del raw
    del dull, light, both
    uncapped = share.astype(np.float16)
    most, dazzling = (np.float32((b - bright) / (1 - bright)) for b in (BRIGHTEST, DAZZLE))
    share = without_lines(share, sides.gel, float(most))
    np.minimum(share, most, out=share)
    # Reflections dazzle. They are taken down where speckle is smoothed enough to know, and before
    # they spread.
    values = working.smoothed(share, 0.6)
    if not bright:
        np.minimum(values, dazzling, out=values)
    values = working.smoothed(values, 0.8)
    del share
    dark = _normalised(values, sides, known, working)
    contrast, blur_mm = _contrast(values, sides), working.blur_mm
    if not bright:
        _refuse_flat(contrast)
    # A reflection too weak to be told moves a wall by up to half a voxel of depth: take the middle.
    facing = UNSEEN_LINE * scan.geometric_voxel_mm[0] / 2
    if bright:
        values, contrast, blur_mm = _softened(values, sides, contrast, working)
        _refuse_flat(contrast)
    field = GelField(values, 0.5, 1.0, working.voxel_mm, working.origin_mm, blur_mm)
    field = replace(
        field,
        faint_mm=facing,
        facing_mm=facing,
        uneven=unevenness(values, working),
    )
    return field, contrast, Strength(signal, noise, uncapped, bright or dark)


def _two_media(signal: FloatVolume, working: Working, depth_down: bool) -> TwoMedia | None:
    if depth_down:
        return two_media(signal, working)
    media = two_media(np.ascontiguousarray(signal[::-1]), working)
    if media is None:
        return None
    sides = Sides(media.sides.gel[::-1], media.sides.liquid[::-1])
    return replace(media, light=media.light[::-1], sides=sides)


def _share_of_step(signal: FloatVolume, both: TwoMedia) -> FloatVolume:
    """Share of gel by the step from liquid to gel."""
    share = signal / both.light
    share -= np.float32(both.liquid)
    share /= np.float32(1 - both.liquid)
    return share


def _normalised(values: FloatVolume, sides: Sides, known: Mask, working: Working) -> float:
    """Map liquid to 0 and gel to 1, in place, by their local levels; return liquid over gel."""
    liquid, gel, factor = _levels(values, sides, known, working)
    normalise(values, liquid, gel, factor)
    return float(np.median(liquid) / np.median(gel))


def _softened(
    values: FloatVolume, sides: Sides, contrast: float, working: Working
) -> tuple[FloatVolume, float, float]:
    """Smooth further until speckle leaves `QUIET`; return values, contrast and blur, mm.

    Speckle falls as the 1.5th power of the blur. Levels are told anew from what is gel and liquid
    then: what passes for either where speckle is strong is brighter, or darker, than all of it.
    """
    wanted = float(np.clip((QUIET / contrast) ** (2 / 3), 1.0, SOFTEST))
    part = float(np.sqrt(wanted**2 - 1))
    soft = working.smoothed(values, part)
    for _ in range(2):
        sides = sides_of(soft > 0.5)
        _normalised(values, sides, np.ones(values.shape, dtype=np.bool_), working)
        soft = working.smoothed(values, part)
    blur = float(np.hypot(working.blur_mm, part * working.smoothing_mm))
    return soft, _contrast(soft, sides), blur


def _noise_floor(signal: FloatVolume, bins: tuple[int, int, int]) -> float:
    """Return the mean noise, from the darkest of blocks that hold `FLOOR_BLOCK` voxels each way.

    A block's mean scatters by its noise (whose standard deviation is its mean, over the root of
    the voxels averaged): the darkest in a thousand lies 3.09 standard deviations below the mean.
    """
    block = _within(signal, (FLOOR_BLOCK,) * 3)
    darkest = float(np.percentile(bin_mean(signal, block, False, 0.0), 0.1))
    looks = float(np.prod(block) * np.prod(bins))
    return darkest / (1.0 - min(3.09 / np.sqrt(looks), 0.8))


def _sides(signal: FloatVolume, light: FloatVolume) -> Sides:
    share = share_of_gel(signal / light, 1.0)
    return Sides(share > 0.97, share < 0.03)


def _refuse_upside_down(signal: FloatVolume, step_mm: float, depth_down: bool) -> None:
    """What is bright must fade along the light's way."""
    bright = signal > BRIGHT * np.percentile(probe(signal), 99.5)
    apart = min(max(1, round(GROWTH_MM / step_mm)), len(signal) - 1)
    both = bright[:-apart] & bright[apart:]
    if not both.any():
        return
    low, high = (float(part[both].mean()) for part in (signal[:-apart], signal[apart:]))
    growth = high / low if depth_down else low / high
    if growth > GROWTH:
        raise SegmentationError(
            f"what is bright grows brighter by {growth:.2f} over {1e3 * GROWTH_MM:g} um of depth "
            f"(limit {GROWTH:g}), as if light came from below: the volume is upside down; turn its "
            "depth axis round"
        )


def _levels(
    values: FloatVolume, sides: Sides, known: Mask, working: Working
) -> tuple[FloatVolume, FloatVolume, tuple[int, int, int]]:
    """Local brightness of liquid and gel on a coarse grid, and the grid's factor."""
    factor = _coarse(working, values)
    voxel = working.voxel_mm[::-1] * factor
    empty = sides.liquid & known
    usual = float(np.median(values[empty])) if empty.any() else 0.0
    liquid = local_level(values, empty, factor, LIQUID_MM / voxel, usual, False)
    gel = local_level(values, sides.gel, factor, GEL_MM / voxel, 1.0, True)
    return liquid, gel, factor


def _contrast(values: FloatVolume, sides: Sides) -> float:
    """Distance of the two levels over the spread of the gel."""
    every = max(1, values.size // 1_000_000)
    chosen = values.ravel()[::every]
    gel = chosen[sides.gel.ravel()[::every]].astype(np.float64)
    spread = 1.4826 * float(np.median(np.abs(gel - np.median(gel)))) if len(gel) else np.inf
    dark = float(np.median(probe(values)[probe(values) < 0.5])) if len(gel) else 1.0
    return (1.0 - dark) / max(spread, 1e-9)


def _refuse_flat(contrast: float) -> None:
    if not contrast >= LEAST_CONTRAST:
        raise SegmentationError(
            f"gel and liquid can't be told apart: their grey values differ by {contrast:.1f} "
            f"standard deviations of the gel (needed: {LEAST_CONTRAST:g}); check that the gel is "
            "the brighter, that scale is right, and the exposure"
        )


def _coarse(working: Working, values: FloatVolume) -> tuple[int, int, int]:
    """Voxels that make about `COARSE_MM`, along z, y, x."""
    fz, fy, fx = np.maximum(1, np.round(COARSE_MM / working.voxel_mm[::-1])).astype(int).tolist()
    return _within(values, (fz, fy, fx))


def _within(values: FloatVolume, factor: tuple[int, int, int]) -> tuple[int, int, int]:
    z, y, x = (min(f, n) for f, n in zip(factor, values.shape, strict=True))
    return z, y, x
