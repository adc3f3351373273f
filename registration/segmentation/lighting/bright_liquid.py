"""Separate gel from liquid nearly as bright in OCT: light and levels in turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from kernels.arrays import BoolArray, Float32Array, FloatArray
from registration.segmentation.filters import bin_mean, gaussian_weights, normalise, smooth
from registration.segmentation.levels import SplitLevels as Levels
from registration.segmentation.levels import split_classes
from registration.segmentation.walls import Sides, smoothed
from registration.segmentation.working import Working

LIT = 0.02
"""Of the strongest light: where there is less classes aren't asked for."""
REACH_MM = (0.25, 0.4, 0.4)
"""The light's slow rest (standard deviations), z, y, x."""
LINEAR, BENT, EVEN = 16, 6, 4
"""Rounds with a straight fall of the light's logarithm, a bent one, and the gel's own level."""
STARTS, THIN = (0.9, 0.8, 0.6), 2
"""Parts of the field's middle that first pass for gel, and of how many blocks along y and x one
says which start is best."""
GEL, ABOVE = 4, 5
"""Places of gel, and of the gel above, among `_terms`."""
BLOCK, BLOCK_BLUR = 3, 0.7
"""Voxels each way that make a block, and how far blocks are averaged (standard deviation)."""


def blocks_of(volume: Float32Array) -> tuple[int, int, int]:
    """Return how many voxels make a block, along z, y, x."""
    z, y, x = (min(BLOCK, n) for n in volume.shape)
    return z, y, x


def first_light(signal: Float32Array, working: Working) -> Float32Array:
    """Light from blocks of both classes: fading with depth and with the gel above (Beer-Lambert).

    Its logarithm is fitted in rounds, with what the last round took for gel; then the slow rest,
    over shorter and shorter ways.
    """
    size = blocks_of(signal)
    blocks = np.maximum(bin_mean(signal, size, False), 1e-12).astype(np.float64)
    blocks = gaussian_filter(blocks, BLOCK_BLUR)
    mean = blocks.mean(axis=(1, 2))
    used = np.broadcast_to((mean > LIT * mean.max())[:, None, None], blocks.shape)
    light = _of_two_classes(blocks, used).light
    for _ in range(EVEN):
        share = blocks / light
        gel, levels = _taken(share, used)
        sure = gaussian_filter(gel.astype(np.float64), 0.7) > 0.8
        sigma = np.array(REACH_MM) / (working.voxel_mm[::-1] * size)
        mass = gaussian_filter(sure.astype(np.float64), sigma) + 0.01
        light = light * (gaussian_filter(sure * share, sigma) + 0.01 * levels.high) / mass
    light = light.astype(np.float32)
    scale = light.max()
    out = np.ones_like(signal)
    normalise(out, np.zeros_like(light), scale / np.maximum(light, 1e-6 * scale), size)
    return out * scale


@dataclass(frozen=True)
class _Fit:
    """Light and gel of blocks, what the logarithm leaves, and whether gel takes light."""

    light: FloatArray
    gel: BoolArray
    rest: float
    fading: bool


def _of_two_classes(blocks: FloatArray, used: BoolArray) -> _Fit:
    """Best of the fits from several starts.

    Rounds of classes and light settle where they began: gel a millimetre down is darker than the
    liquid beside it, and rounds that begin with a plane may end with the classes exchanged. Then
    what is above *adds* light, which no medium does, or the fit leaves more.
    """
    thin = (slice(None), slice(None, None, THIN), slice(None, None, THIN))
    few, few_used = blocks[thin], used[thin]
    starts = [None, *(_middle(few.shape, part) for part in STARTS)]
    orders = (*[1] * LINEAR, *[2] * BENT)
    fits = [_fitted(few, few_used, start, orders) for start in starts]
    best = min(fits, key=lambda fit: (not fit.fading, fit.rest))
    gel = best.gel.repeat(THIN, axis=1).repeat(THIN, axis=2)
    gel = gel[:, : blocks.shape[1], : blocks.shape[2]]
    return _fitted(blocks, used, gel, (2,) * BENT)


def _fitted(
    blocks: FloatArray, used: BoolArray, gel: BoolArray | None, orders: tuple[int, ...]
) -> _Fit:
    """Fit the logarithm by classes and light together, classes anew each round."""
    level = np.log(blocks)
    wanted = level[used]
    for order in orders:
        terms = _terms(blocks.shape, gel, order)
        chosen = np.stack([np.broadcast_to(term, blocks.shape)[used] for term in terms])
        weight = np.linalg.lstsq(chosen @ chosen.T, chosen @ wanted, rcond=None)[0]
        # The brightness of gel over liquid, where it is known, isn't light's.
        kept = [k for k in range(len(terms)) if gel is None or k != GEL]
        light = np.exp(sum(weight[k] * terms[k] for k in kept))
        rest = float(np.std(wanted - weight @ chosen))
        fading = gel is None or bool(weight[ABOVE] < 0)
        gel, _ = _taken(blocks / light, used)
    assert gel is not None
    return _Fit(light, gel, rest, fading)


def _middle(shape: tuple[int, ...], part: float) -> BoolArray:
    """Return the middle of a volume, a part of it along each axis."""
    out = np.zeros(shape, dtype=np.bool_)
    out[tuple(slice(round(n * (1 - part) / 2), round(n * (1 + part) / 2)) for n in shape)] = True
    return out


def _taken(share: FloatArray, used: BoolArray) -> tuple[BoolArray, Levels]:
    levels = split_classes(share[used])
    return share > levels.middle, levels


def _terms(shape: tuple[int, ...], gel: BoolArray | None, order: int) -> list[FloatArray]:
    """What the logarithm may depend on: nothing, place, gel, gel above, depth squared."""
    classes = [] if gel is None else [gel.astype(np.float64), np.cumsum(gel, axis=0) / len(gel)]
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij", sparse=True)
    bent = [z**2] if order > 1 else []
    return [np.ones((1, 1, 1)), z, y, x, *classes, *bent]


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

    light: Float32Array
    sides: Sides
    liquid: float


def softly_split(ratio: Float32Array, lit: BoolArray) -> tuple[Float32Array, Levels]:
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


def liquid_is_dark(signal: Float32Array, light: Float32Array, floor: Float32Array) -> bool:
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
    back, beam = (bin_mean(one, size, False) for one in (signal, light))
    noise = bin_mean(np.ascontiguousarray(floor), (size[0], 1, 1), False)
    lit = beam > np.maximum(LIT * np.float32(np.percentile(beam, 99)), 4 * noise)
    share = (back + noise)[lit] / beam[lit]
    levels = split_classes(share.astype(np.float64)) if lit.any() else Levels(0.0, 1.0, 0.0)
    return levels.two and levels.low < BRIGHT * levels.high


def sides_of(gel: BoolArray) -> Sides:
    """Return what is well within the gel, and well without."""
    share = np.empty(gel.shape, dtype=np.float32)
    near = gaussian_weights(1.2)
    smooth(gel, share, (near, near, near), 0.0)
    return Sides(share > 0.97, share < 0.03)


def two_media(signal: Float32Array, working: Working) -> TwoMedia | None:
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


def _liquid(ratio: Float32Array, sides: Sides, lit: BoolArray) -> float:
    """Brightness of liquid over that of gel, well within both."""
    bounded = np.minimum(ratio, np.float32(4 * GLARE))
    gel, liquid = (bounded[side & lit].mean() for side in (sides.gel, sides.liquid))
    return float(liquid / gel)


def _saved(
    back: Float32Array,
    light: Float32Array,
    gel: BoolArray,
    sides: Sides,
    working: Working,
) -> Float32Array:
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
    back: Float32Array, light: Float32Array, sides: Sides, liquid: float, working: Working
) -> Float32Array:
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
        smoothed(bin_mean(weight * one, (z, y, x), False), (deep, along, aside))
        for one in (came, sent)
    )
    none = np.float32(1e-6 * float(should.max()))
    level = np.clip((should + none) / (np.maximum(had, 0) + none), 0.2, 5.0)
    evened = np.ones_like(light)
    normalise(evened, np.zeros_like(level), level.astype(np.float32), (z, y, x))
    return np.asarray(light * evened, dtype=np.float32)
