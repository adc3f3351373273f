"""First OCT light estimate if liquid is bright: fit log light and gel classes in turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from kernels.arrays import FloatArray
from registration.segmentation.classes import Levels, split_classes
from registration.segmentation.filters import bin_mean, normalise
from registration.segmentation.working import Working

FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]

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


def blocks_of(volume: FloatVolume) -> tuple[int, int, int]:
    """Return how many voxels make a block, along z, y, x."""
    z, y, x = (min(BLOCK, n) for n in volume.shape)
    return z, y, x


def first_light(signal: FloatVolume, working: Working) -> FloatVolume:
    """Light from blocks of both classes: fading with depth and with the gel above (Beer-Lambert).

    Its logarithm is fitted in rounds, with what the last round took for gel; then the slow rest,
    over shorter and shorter ways.
    """
    size = blocks_of(signal)
    blocks = np.maximum(bin_mean(signal, size, False, 0.0), 1e-12).astype(np.float64)
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
    gel: Mask
    rest: float
    fading: bool


def _of_two_classes(blocks: FloatArray, used: Mask) -> _Fit:
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


def _fitted(blocks: FloatArray, used: Mask, gel: Mask | None, orders: tuple[int, ...]) -> _Fit:
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


def _middle(shape: tuple[int, ...], part: float) -> Mask:
    """Return the middle of a volume, a part of it along each axis."""
    out = np.zeros(shape, dtype=np.bool_)
    out[tuple(slice(round(n * (1 - part) / 2), round(n * (1 + part) / 2)) for n in shape)] = True
    return out


def _taken(share: FloatArray, used: Mask) -> tuple[Mask, Levels]:
    levels = split_classes(share[used])
    return share > levels.middle, levels


def _terms(shape: tuple[int, ...], gel: Mask | None, order: int) -> list[FloatArray]:
    """What the logarithm may depend on: nothing, place, gel, gel above, depth squared."""
    classes = [] if gel is None else [gel.astype(np.float64), np.cumsum(gel, axis=0) / len(gel)]
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij", sparse=True)
    bent = [z**2] if order > 1 else []
    return [np.ones((1, 1, 1)), z, y, x, *classes, *bent]
