"""Light of a scan before anything is known: from blocks of voxels, in rounds with their classes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, percentile_filter

from registration.segmentation.classes import Levels, split
from registration.segmentation.filters import bin_mean, normalise
from registration.segmentation.working import Working

FloatArray = NDArray[np.float64]
FloatVolume = NDArray[np.float32]
Mask = NDArray[np.bool_]

LIT = 0.02
"""Of the strongest light: where there is less classes aren't asked for."""
REACH_MM = (0.25, 0.4, 0.4)
"""The light's slow rest (standard deviations), z, y, x."""
LINEAR, BENT, EVEN = 16, 6, 4
"""Rounds with a straight fall of the light's logarithm, a bent one, and the gel's own level."""
BLOCK, BLOCK_BLUR = 3, 0.7
"""Voxels each way that make a block, and how far blocks are averaged (standard deviation)."""
ENVELOPE_MM, UPPER, LEAST_ENVELOPE = 1.5, 75, 0.7
"""Of so wide a neighbourhood this percentile is gel; it is no darker than this part of the usual,
far outside of the gel."""


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
    level = np.log(blocks)
    gel, target = None, level
    for order in (*[1] * LINEAR, *[2] * BENT):
        terms = _terms(blocks.shape, gel, order)
        chosen = np.stack([np.broadcast_to(term, blocks.shape)[used] for term in terms])
        weight = np.linalg.lstsq(chosen.T, target[used], rcond=None)[0]
        light = np.exp(sum(w * t for w, t in zip(weight, terms, strict=True)))
        gel, levels = _taken(blocks / light, used)
        target = level - np.log(np.where(gel, levels.high, max(levels.low, 1e-6)))
    light = light * _envelope(blocks / light, working.voxel_mm[::-1] * size)
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


def _envelope(share: FloatArray, step: FloatArray) -> FloatArray:
    """Level of what is brighter around each block: gel, but far outside of it."""
    every = np.maximum(1, np.round(ENVELOPE_MM / 6 / step)).astype(int)
    thin = share[tuple(slice(e // 2, None, e) for e in every)]
    size = np.maximum(3, np.round(ENVELOPE_MM / (step * every))).astype(int)
    level = percentile_filter(thin, UPPER, size=tuple(size), mode="nearest")
    level = np.maximum(level, LEAST_ENVELOPE * np.median(level))
    level = gaussian_filter(level, 1.0)
    place = np.stack(
        np.meshgrid(*((np.arange(n) - e // 2) / e for n, e in zip(share.shape, every, strict=True)),
                    indexing="ij")
    )  # fmt: skip
    return np.asarray(map_coordinates(level, place, order=1, mode="nearest"))


def _taken(share: FloatArray, used: Mask) -> tuple[Mask, Levels]:
    levels = split(share[used])
    return share > levels.middle, levels


def _terms(shape: tuple[int, ...], gel: Mask | None, order: int) -> list[FloatArray]:
    """What the light's logarithm may depend on: nothing, place, gel above, depth squared."""
    above = [] if gel is None else [np.cumsum(gel, axis=0) / len(gel)]
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij", sparse=True)
    bent = [z**2] if order > 1 else []
    return [np.ones((1, 1, 1)), z, y, x, *above, *bent]
