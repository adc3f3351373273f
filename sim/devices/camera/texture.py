"""Texture of a granular bath and waves of its surface: seeded noise that lies still in the dish."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.devices.camera.plan import Plan

SingleArray = NDArray[np.float32]

_TILE: Final = 1024
_PER_GRAIN: Final = 3.0
"""Texels of a tile in a grain."""
_OCTAVES: Final = ((1.0, 0.6), (2.7, 0.5), (8.3, 0.45), (31.0, 0.4))
"""Size over the finest granule, and its share; no two sizes have a common measure, so that no
tile's repetition shows."""

_MAGNIFIED: Final = 0.2
"""Texels a pixel below which straight lines between them would be seen."""


def granules(plan: Plan, granule_mm: float, seed: int) -> SingleArray:
    """Brightness of a granular bath about 0, standard deviation 1, (rows, columns)."""
    out = np.zeros(plan.shape, np.float32)
    for number, (size, share) in enumerate(_OCTAVES):
        tile = _noise_tile(seed, number)
        if number == 0:
            # Granules have edges: bright bodies with dark seams between them.
            tile = np.abs(tile)
            tile = (tile - tile.mean()) / tile.std()
        out += np.float32(share) * _laid_out(tile, plan, granule_mm * size)
    return out / np.float32(np.sqrt(sum(share**2 for _, share in _OCTAVES)))


def waves(plan: Plan, size_mm: float, seed: int, step: int) -> SingleArray:
    """Height of a wavy surface about 0, standard deviation 1, at every `step`-th pixel."""
    rows, columns = (count // step + 2 for count in plan.shape)
    coarse = Plan(
        plan.camera, plan.z_mm, plan.index, plan.origin_mm, plan.pitch_mm * step, (rows, columns)
    )
    surface = _laid_out(_noise_tile(seed, len(_OCTAVES)), coarse, size_mm)
    # A bend at every texel would be seen in a glint.
    return cv2.GaussianBlur(surface, (0, 0), max(0.8, 0.6 * size_mm / _PER_GRAIN / coarse.pitch_mm))


@lru_cache(maxsize=8)
def _noise_tile(seed: int, number: int) -> SingleArray:
    """Smooth noise without seams at its rim, standard deviation 1."""
    drawn = np.random.default_rng((seed, 7, number)).standard_normal((_TILE, _TILE), np.float32)
    sigma, pad = _PER_GRAIN / 2.5, 8
    wide = np.pad(drawn, pad, mode="wrap")
    smooth = cv2.GaussianBlur(wide, (0, 0), sigma)[pad:-pad, pad:-pad]
    return np.ascontiguousarray(smooth / smooth.std(), dtype=np.float32)


def _laid_out(tile: SingleArray, plan: Plan, grain_mm: float) -> SingleArray:
    """A tile over the plan, again and again, by the printer's coordinates."""
    texel = grain_mm / _PER_GRAIN
    scale = plan.pitch_mm / texel
    x, y = np.mod(plan.origin_mm / texel, _TILE)
    rows, columns = plan.shape
    between = cv2.INTER_CUBIC if scale < _MAGNIFIED else cv2.INTER_LINEAR
    return np.asarray(
        cv2.warpAffine(
            tile,
            np.array([[scale, 0, x], [0, scale, y]]),
            (columns, rows),
            flags=between | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_WRAP,
        )
    )
