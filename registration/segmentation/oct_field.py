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
from scipy.ndimage import minimum_filter

from kernels.arrays import BoolArray, Float32Array
from registration.errors import SegmentationError
from registration.scan import Scan
from registration.segmentation.filters import (
    bin_mean,
    gaussian_weights,
    near_in_depth,
    normalise,
    smooth,
)
from registration.segmentation.lighting.bright_liquid import (
    TwoMedia,
    liquid_is_dark,
    sides_of,
    two_media,
)
from registration.segmentation.lighting.even_light import even_signal, without_glare
from registration.segmentation.lighting.light import remaining_light, share_of_gel
from registration.segmentation.response import depth_response
from registration.segmentation.volume import GelField, Strength
from registration.segmentation.walls import Sides, local_level, share_of_volume
from registration.segmentation.working import Working, probe

# Inside gel a segmented field is 1 but for speckle. Gel in layers (birefringent collagen under
# light of one polarisation, prints of two inks), shadows and haze leave it brighter here and darker
# there, over lengths that local levels don't follow; a wall there is held against a level that
# isn't its gel's.
BLOCK_MM = (0.06, 0.3, 0.3)
"""Averaged, z, y, x: layers lie across the light, and speckle is averaged along them."""
DARKEST, SHARE = 0.25, 0.97
"""A block is gel where this share of it lies above that level: dark layers do, liquid doesn't."""
WITHIN = (5, 3, 3)
"""So many blocks about one are gel: 0.12 mm and more from any wall."""
FEWEST = 30
"""Such blocks tell a spread."""


def unevenness(values: Float32Array, working: Working) -> float:
    """Return the standard deviation of the gel's level beyond speckle, of the step to liquid.

    The spread of blocks, less that between neighbours at the same depth, which is speckle's (and
    robust: layers of one depth make no such difference). 0 where too little gel is thick enough.

    Parameters
    ----------
    values : (nz, ny, nx) float32
        Gel 1, liquid 0.
    working : Working
    """
    wanted = np.maximum(1, np.round(np.array(BLOCK_MM) / working.voxel_mm[::-1])).astype(int)
    block = tuple(np.minimum(wanted, values.shape).tolist())
    full = bin_mean(values > np.float32(DARKEST), block, False) > SHARE
    inside = minimum_filter(full.astype(np.uint8), WITHIN, mode="constant") > 0
    level = bin_mean(values, block, False)
    if np.count_nonzero(inside) < FEWEST:
        return 0.0
    both = inside[:, :, 1:] & inside[:, :, :-1]
    speckle = _spread(np.diff(level, axis=2)[both]) / np.sqrt(2) if both.any() else 0.0
    return float(np.sqrt(max(_spread(level[inside]) ** 2 - speckle**2, 0.0)))


def _spread(values: NDArray[np.float32]) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


# An index step sends back many times what gel does, from a line one or two voxels deep where the
# wall is smooth, from a band of glints where it is rough. Counted as gel it moves the half level
# into the liquid by its width. What outshines the gel's own speckle belongs to a wall, which by
# definition has as much gel before as behind: its voxels count as half gel, and the wall comes out
# at their middle.
#
# How bright speckle gets is asked of gel far from any wall, in averages of several sizes: level
# walls show in averages along the wall, glints in single voxels, rough walls in averages of depth
# too. Whatever is taken for a line without being one moves walls into the gel.
CHANCE = 1e-3
"""Of the peaks within gel, so many stand out as far as what is taken for a line."""
SCALES = ((0.0, 0.0), (0.8, 0.0), (1.2, 1.0))
"""Standard deviations of the averages along the wall and in depth, voxels."""
MAX_REFLECTION = 4.0
"""Times the gel: no voxel counts for more in averages, or a line would spill."""
LEAST = 1.2
"""Times the gel: a line is never fainter."""
INSIDE = 6
"""With gel so many voxels above and below a place has no wall's light: there gel is asked for its
own peaks, and what is bright is a particle."""


def without_lines(share: Float32Array, gel: BoolArray, brightest: float) -> Float32Array:
    """Return shares of gel (nz, ny, nx) with reflections of walls taken for half gel.

    Parameters
    ----------
    share : (nz, ny, nx) float32
        1 for gel, speckle and all; changed in place.
    gel : (nz, ny, nx) bool
        Well within the gel: how far speckle stands out there is no sign of a line.
    brightest : float
        No voxel will count for more than this.
    """
    inside = ~near_in_depth(~gel, INSIDE)
    lines = np.zeros(share.shape, dtype=np.bool_)
    dazzled = np.minimum(share, np.float32(MAX_REFLECTION))
    for along, deep in SCALES:
        bright = _smoothed(dazzled, along, deep) if along else share
        lines |= bright >= _stands_out(bright, inside)
    lines &= ~inside
    usual = np.minimum(share[inside], np.float32(brightest))
    share[lines] = 0.5 * float(usual.mean(dtype=np.float64)) if len(usual) else 0.5
    return share


def _smoothed(share: Float32Array, along: float, deep: float) -> Float32Array:
    out = np.empty_like(share)
    weights = gaussian_weights(along)
    smooth(share, out, (gaussian_weights(deep), weights, weights), 0.0)
    return out


def _stands_out(bright: Float32Array, gel: BoolArray) -> np.float32:
    """Brightness that of gel's own peaks along depth only `CHANCE` exceed, at least `LEAST`."""
    here = bright[1:-1]
    peaks = here[gel[1:-1] & (here > bright[:-2]) & (here > bright[2:])]
    return np.float32(max(float(np.quantile(peaks, 1 - CHANCE)) if len(peaks) else 0.0, LEAST))


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


def _two_media(signal: Float32Array, working: Working, depth_down: bool) -> TwoMedia | None:
    if depth_down:
        return two_media(signal, working)
    media = two_media(np.ascontiguousarray(signal[::-1]), working)
    if media is None:
        return None
    sides = Sides(media.sides.gel[::-1], media.sides.liquid[::-1])
    return replace(media, light=media.light[::-1], sides=sides)


def _share_of_step(signal: Float32Array, both: TwoMedia) -> Float32Array:
    """Share of gel by the step from liquid to gel."""
    share = signal / both.light
    share -= np.float32(both.liquid)
    share /= np.float32(1 - both.liquid)
    return share


def _normalised(values: Float32Array, sides: Sides, known: BoolArray, working: Working) -> float:
    """Map liquid to 0 and gel to 1, in place, by their local levels; return liquid over gel."""
    liquid, gel, factor = _levels(values, sides, known, working)
    normalise(values, liquid, gel, factor)
    return float(np.median(liquid) / np.median(gel))


def _softened(
    values: Float32Array, sides: Sides, contrast: float, working: Working
) -> tuple[Float32Array, float, float]:
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


def _noise_floor(signal: Float32Array, bins: tuple[int, int, int]) -> float:
    """Return the mean noise, from the darkest of blocks that hold `FLOOR_BLOCK` voxels each way.

    A block's mean scatters by its noise (whose standard deviation is its mean, over the root of
    the voxels averaged): the darkest in a thousand lies 3.09 standard deviations below the mean.
    """
    block = _within(signal, (FLOOR_BLOCK,) * 3)
    darkest = float(np.percentile(bin_mean(signal, block, False), 0.1))
    looks = float(np.prod(block) * np.prod(bins))
    return darkest / (1.0 - min(3.09 / np.sqrt(looks), 0.8))


def _sides(signal: Float32Array, light: Float32Array) -> Sides:
    share = share_of_gel(signal / light, 1.0)
    return Sides(share > 0.97, share < 0.03)


def _refuse_upside_down(signal: Float32Array, step_mm: float, depth_down: bool) -> None:
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
    values: Float32Array, sides: Sides, known: BoolArray, working: Working
) -> tuple[Float32Array, Float32Array, tuple[int, int, int]]:
    """Local brightness of liquid and gel on a coarse grid, and the grid's factor."""
    factor = _coarse(working, values)
    voxel = working.voxel_mm[::-1] * factor
    empty = sides.liquid & known
    usual = float(np.median(values[empty])) if empty.any() else 0.0
    liquid = local_level(values, empty, factor, LIQUID_MM / voxel, usual, False)
    gel = local_level(values, sides.gel, factor, GEL_MM / voxel, 1.0, True)
    return liquid, gel, factor


def _contrast(values: Float32Array, sides: Sides) -> float:
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


def _coarse(working: Working, values: Float32Array) -> tuple[int, int, int]:
    """Voxels that make about `COARSE_MM`, along z, y, x."""
    fz, fy, fx = np.maximum(1, np.round(COARSE_MM / working.voxel_mm[::-1])).astype(int).tolist()
    return _within(values, (fz, fy, fx))


def _within(values: Float32Array, factor: tuple[int, int, int]) -> tuple[int, int, int]:
    z, y, x = (min(f, n) for f, n in zip(factor, values.shape, strict=True))
    return z, y, x
