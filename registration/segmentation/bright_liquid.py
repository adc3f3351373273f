"""Separate gel from liquid nearly as bright in OCT: find light and both levels in turns.

Half of the gel's brightness is no threshold there, and what a place sends back no measure of what
it takes from the light (`light` rests on that). Both levels and the light are found together, in
rounds: a split of the averaged share into two classes (Ridler & Calvard 1978,
10.1109/TSMC.1978.4310039), what the liquid above saves of the light (Beer-Lambert, regressed), and
the slow rest of the light from both classes, as a bias field (Wells et al. 1996,
10.1109/42.511747).

The noise floor stays in both: the darkest place holds bright liquid, and is no measure of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from registration.segmentation.classes import Levels, split_classes
from registration.segmentation.filters import bin_mean, gaussian_weights, normalise, smooth
from registration.segmentation.first_light import LIT, REACH_MM, blocks_of, first_light
from registration.segmentation.walls import Sides, smoothed
from registration.segmentation.working import Working

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]

BRIGHT = 0.33
"""Of the gel's brightness: of brighter liquid light and levels are found together."""
DARK = 0.2
"""The same, once both media are known by their light: darker liquid needs no threshold of its own,
but up to here the noise floor would be liquid's."""
SOFTEST = 3.2
"""Voxels, standard deviation: averages over more see no lumen."""
ROUNDS = 4
GLARE = 4.0
"""Times the gel: no voxel counts for more in averages."""
COARSE_MM = 0.09
LIQUID_WEIGHT = 0.1
"""Of liquid against gel, where both tell the light: liquids may differ in brightness."""


@dataclass(frozen=True)
class TwoMedia:
    """Light and classes of a scan.

    Attributes
    ----------
    light : (nz, ny, nx) float32
        What gel would send back from each voxel.
    sides : Sides
    liquid : float
        Brightness of liquid, of the gel's, noise and all.
    """

    light: FloatVolume
    sides: Sides
    liquid: float


def softly_split(ratio: FloatVolume, lit: Mask) -> tuple[FloatVolume, Levels]:
    """Return the share averaged until it has two classes, and them."""
    sigma, bounded = 1.2, np.clip(ratio, -GLARE, GLARE)
    soft = np.empty_like(ratio)
    every = max(1, ratio.size // 1_000_000)
    while True:
        weights = gaussian_weights(sigma)
        smooth(bounded, soft, (weights, weights, weights), 0.0)
        chosen = soft.ravel()[::every][lit.ravel()[::every]].astype(np.float64)
        levels = split_classes(chosen) if len(chosen) else Levels(0.0, 0.0, 0.0)
        if levels.two or sigma >= SOFTEST:
            return soft, levels
        sigma = min(1.4 * sigma, SOFTEST)


def liquid_is_dark(signal: FloatVolume, light: FloatVolume, floor: FloatVolume) -> bool:
    """Whether blocks of the share are of two classes, the lower darker than `BRIGHT`.

    Half of the gel's brightness is a threshold then.

    Parameters
    ----------
    signal, light : (nz, ny, nx) float32
        Without noise floor and glare, and what gel would send back.
    floor : (nz, 1, 1) float32
        The noise floor that was taken off, in the signal's measure.
    """
    size = blocks_of(signal)
    back, beam = (bin_mean(one, size, False, 0.0) for one in (signal, light))
    noise = bin_mean(np.ascontiguousarray(floor), (size[0], 1, 1), False, 0.0)
    lit = beam > np.maximum(LIT * np.float32(np.percentile(beam, 99)), 4 * noise)
    share = (back + noise)[lit] / beam[lit]
    levels = split_classes(share.astype(np.float64)) if lit.any() else Levels(0.0, 1.0, 0.0)
    return levels.two and levels.low < BRIGHT * levels.high


def sides_of(gel: Mask) -> Sides:
    """Return what is well within the gel, and well without."""
    share = np.empty(gel.shape, dtype=np.float32)
    near = gaussian_weights(1.2)
    smooth(gel, share, (near, near, near), 0.0)
    return Sides(share > 0.97, share < 0.03)


def two_media(signal: FloatVolume, working: Working) -> TwoMedia | None:
    """Return light and classes, or None where liquid is dark or can't be told from gel.

    Parameters
    ----------
    signal : (nz, ny, nx) float32
        Without glare, noise and all; light comes from above.
    working : Working
    """
    media: TwoMedia | None = None
    light = first_light(signal, working)
    for _ in range(ROUNDS):
        lit = light > LIT * float(np.percentile(light[::4, ::4, ::4], 99))
        soft, levels = softly_split(signal / light, lit)
        if not levels.two or levels.low < DARK * levels.high:
            return media
        gel = soft > levels.middle
        sides = sides_of(gel)
        if not (sides.gel & lit).any() or not (sides.liquid & lit).any():
            return media
        light = _saved(signal, light, gel, sides, working)
        liquid = _liquid(signal / light, sides, lit)
        light = _evened(signal, light, sides, liquid, working)
        media = TwoMedia(light, sides, liquid)
    return media


def _liquid(ratio: FloatVolume, sides: Sides, lit: Mask) -> float:
    """Brightness of liquid over that of gel, well within both."""
    bounded = np.minimum(ratio, np.float32(4 * GLARE))
    gel, liquid = (bounded[side & lit].mean() for side in (sides.gel, sides.liquid))
    return float(liquid / gel)


def _saved(
    back: FloatVolume,
    light: FloatVolume,
    gel: Mask,
    sides: Sides,
    working: Working,
) -> FloatVolume:
    """Light with what liquid above a voxel saves beyond what its depth's mean has."""
    length = np.cumsum(np.maximum.accumulate(gel, axis=0) & ~gel, axis=0, dtype=np.float32)
    length *= np.float32(working.voxel_mm[2])
    length -= length.mean(axis=(1, 2), keepdims=True)
    every = max(1, gel.size // 2_000_000)
    chosen = np.flatnonzero(sides.gel.ravel()[::every]) * every
    apart = length.ravel()[chosen].astype(np.float64)
    depth = chosen // gel[0].size
    ratio = np.minimum(back.ravel()[chosen] / light.ravel()[chosen], GLARE)
    count = np.maximum(np.bincount(depth, minlength=len(gel)), 1)
    centred = ratio - (np.bincount(depth, ratio, len(gel)) / count)[depth]
    apart -= (np.bincount(depth, apart, len(gel)) / count)[depth]
    square = float((apart**2).sum())
    slope = float((apart * centred).sum()) / square if square > 0 else 0.0
    return light * np.exp(np.float32(slope) * length)


def _evened(
    back: FloatVolume, light: FloatVolume, sides: Sides, liquid: float, working: Working
) -> FloatVolume:
    """Light times the slow rest that both classes tell."""
    voxel = working.voxel_mm[::-1]
    z, y, x = np.minimum(np.maximum(1, np.round(COARSE_MM / voxel)).astype(int),
                         back.shape).tolist()  # fmt: skip
    weight = sides.gel + np.float32(LIQUID_WEIGHT) * sides.liquid
    sent = light * np.where(sides.gel, np.float32(1.0), np.float32(liquid))
    came = np.minimum(back, np.float32(GLARE) * sent)
    sigma = np.array(REACH_MM) / (voxel * (z, y, x))
    deep, along, aside = (gaussian_weights(float(s)) for s in sigma)
    had, should = (
        smoothed(bin_mean(weight * one, (z, y, x), False, 0.0), (deep, along, aside))
        for one in (came, sent)
    )
    none = np.float32(1e-6 * float(should.max()))
    level = np.clip((should + none) / (np.maximum(had, 0) + none), 0.2, 5.0)
    evened = np.ones_like(light)
    normalise(evened, np.zeros_like(level), level.astype(np.float32), (z, y, x))
    return np.asarray(light * evened, dtype=np.float32)
