"""Draw bubbles, fibres and specks into a simulated picture, fixed in the dish by a seed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from sim.devices.camera.plan import Plan
from sim.devices.camera.scene import Clutter, Light

SingleArray = NDArray[np.float32]

_TILE_MM: Final = 10.0
"""Clutter is drawn by squares of the printer's plane: a camera that is moved sees the same."""
_SHIFT: Final = 4
_FIBRE_KNOTS: Final = 12


def add_clutter(drawn: SingleArray, plan: Plan, clutter: Clutter, light: Light, seed: int) -> None:
    """Draw all of it into a plane of light, in place."""
    for at, generator in _places(plan, clutter.debris_per_cm2, (seed, 1)):
        _speck(drawn, plan, at, clutter.debris_mm, generator)
    for at, generator in _places(plan, clutter.bubbles_per_cm2, (seed, 2)):
        _bubble(drawn, plan, at, clutter.bubble_mm, light, generator)


def _places(
    plan: Plan, per_cm2: float, seed: tuple[int, int]
) -> Iterator[tuple[FloatArray, np.random.Generator]]:
    """Pixels of things strewn at random, each with a generator of its own."""
    if per_cm2 == 0:
        return
    size = np.array(plan.shape[::-1]) * plan.pitch_mm
    first = np.floor(plan.origin_mm / _TILE_MM).astype(int)
    last = np.floor((plan.origin_mm + size) / _TILE_MM).astype(int)
    for j in range(first[1], last[1] + 1):
        for i in range(first[0], last[0] + 1):
            generator = np.random.default_rng((*seed, i % 2**16, j % 2**16))
            for _ in range(generator.poisson(per_cm2 * _TILE_MM**2 / 100)):
                at = (np.array([i, j]) + generator.random(2)) * _TILE_MM
                yield (at - plan.origin_mm) / plan.pitch_mm, generator


def _bubble(
    drawn: SingleArray,
    plan: Plan,
    at: FloatArray,
    size_mm: float,
    light: Light,
    generator: np.random.Generator,
) -> None:
    """Dark rim by total reflection, a clear middle, the lamp's image on the side of the light."""
    radius = size_mm / plan.pitch_mm / 2 * generator.lognormal(0.0, 0.35)
    patch, away, off = _around(drawn, at, 1.3 * radius + 2)
    if patch is None:
        return
    q = away / radius
    inside = np.clip(radius - away + 0.5, 0, 1)
    rim = np.exp(-(((q - 0.88) / 0.12) ** 2))
    azimuth = np.radians(light.azimuth_deg)
    lamp = off / radius - 0.55 * np.array([np.cos(azimuth), np.sin(azimuth)])
    glint = np.exp(-(lamp**2).sum(axis=-1) / (2 * 0.12**2))
    glow = np.exp(
        -((off / radius + 0.5 * np.array([np.cos(azimuth), np.sin(azimuth)])) ** 2).sum(-1) / 0.18
    )
    factor = 1 - inside * (0.65 * rim - 0.12 * (1 - rim) - 0.1 * glow)
    patch *= factor[..., None].astype(np.float32)
    patch += (200 * glint * inside)[..., None].astype(np.float32)


def _speck(
    drawn: SingleArray, plan: Plan, at: FloatArray, size_mm: float, generator: np.random.Generator
) -> None:
    """A dark or light grain, or a fibre that bends at random."""
    long = size_mm / plan.pitch_mm * generator.lognormal(0.0, 0.4)
    dark = 0.35 + 0.4 * generator.random()
    if generator.random() < 0.5:
        patch, away, _ = _around(drawn, at, 0.2 * long + 2)
        if patch is not None:
            cover = np.clip(0.15 * long - away + 0.5, 0, 1)
            patch *= (1 - (1 - dark) * cover)[..., None].astype(np.float32)
        return
    turn = generator.uniform(0, 2 * np.pi) + np.cumsum(
        0.35 * generator.standard_normal(_FIBRE_KNOTS)
    )
    way = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]) * long / _FIBRE_KNOTS, axis=0)
    path = at + way - way.mean(axis=0)
    low = np.floor(path.min(axis=0)).astype(int) - 3
    size = np.ceil(path.max(axis=0)).astype(int) + 4 - low
    mask = np.zeros((size[1], size[0]), np.uint8)
    knots = np.round((path - low) * 2**_SHIFT).astype(np.int32)
    thick = max(1, round(0.012 / plan.pitch_mm))
    cv2.polylines(mask, [knots], False, 255, thick, cv2.LINE_AA, _SHIFT)
    rows, columns = drawn.shape[:2]
    (x0, y0), (x1, y1) = np.clip([low, low + size], 0, [columns, rows])
    cover = mask[y0 - low[1] : y1 - low[1], x0 - low[0] : x1 - low[0]].astype(np.float32) / 255
    drawn[y0:y1, x0:x1] *= (1 - np.float32(1 - dark) * cover)[..., None]


def _around(
    drawn: SingleArray, at: FloatArray, reach: float
) -> tuple[SingleArray | None, FloatArray, FloatArray]:
    """The part of a plane about a place, and each pixel's distance and way from there."""
    rows, columns = drawn.shape[:2]
    x0, y0 = np.clip(np.floor(at - reach).astype(int), 0, [columns, rows])
    x1, y1 = np.clip(np.ceil(at + reach).astype(int) + 1, 0, [columns, rows])
    if x0 >= x1 or y0 >= y1:
        return None, np.zeros(0), np.zeros(0)
    y, x = np.mgrid[y0:y1, x0:x1]
    off = np.stack([x - at[0], y - at[1]], axis=-1)
    return drawn[y0:y1, x0:x1], np.hypot(off[..., 0], off[..., 1]), off
