"""Optical model of a phantom scan: gel share of each voxel, attenuation, noise, speckle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Edge of a cell that knows which pieces are near, mm.
CELL_MM = 0.25


@dataclass(frozen=True)
class Light:
    """An instrument and a gel.

    Attributes
    ----------
    counts : float
        Gel at the surface.
    attenuation_mm : float, 1/mm
    liquid : float
        Scattering of the liquid over the gel's.
    noise : float
        Counts of the floor.
    looks : int
        Speckle patterns averaged.
    """

    counts: float = 12_000.0
    attenuation_mm: float = 0.6
    liquid: float = 0.03
    noise: float = 8.0
    looks: int = 3


def cells_of(
    size: FloatArray, pieces: FloatArray, radius: FloatArray, balls: FloatArray
) -> tuple[FloatArray, IntArray, IntArray, IntArray]:
    """A grid over the block: origin, counts, offsets and the pieces near each cell.

    Balls are numbered after the pieces.
    """
    reach = CELL_MM * math.sqrt(3) / 2 + 0.1
    origin = np.full(3, -2 * CELL_MM)
    count = np.ceil((size + 4 * CELL_MM) / CELL_MM).astype(np.int64)
    index = np.indices(count).reshape(3, -1).T
    centre = origin + (index + 0.5) * CELL_MM
    near: list[IntArray] = []
    for k in range(len(pieces)):
        a, b = pieces[k, :3], pieces[k, 3:]
        t = np.clip((centre - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        away = np.linalg.norm(centre - a - t[:, None] * (b - a), axis=1)
        near.append(np.flatnonzero(away < radius[k].max() + reach))
    for ball in balls:
        near.append(np.flatnonzero(np.linalg.norm(centre - ball[:3], axis=1) < ball[3] + reach))
    owner = np.repeat(np.arange(len(near)), [len(n) for n in near])
    cell = np.concatenate(near)
    order = np.argsort(cell, kind="stable")
    offset = np.searchsorted(cell[order], np.arange(len(centre) + 1))
    return origin, count, offset, owner[order]


def render(
    shape: tuple[int, int, int],
    voxel_mm: tuple[float, float, float],
    to_part: FloatArray,
    size: FloatArray,
    pieces: FloatArray,
    radius: FloatArray,
    balls: FloatArray,
    plugs: FloatArray,
    cells: tuple[FloatArray, IntArray, IntArray, IntArray],
    light: Light,
    seed: int,
) -> NDArray[np.uint16]:
    """The scan, (nz, ny, nx)."""
    nx, ny, nz = shape
    numbers = np.array([light.counts, light.attenuation_mm, light.liquid, light.noise])
    return _render(
        nx, ny, nz, np.array(voxel_mm), np.ascontiguousarray(to_part), size, pieces, radius,
        balls, plugs, *cells, numbers, light.looks, np.uint64(seed + 1),
    )  # fmt: skip


@numba.njit(inline="always")
def _mixed(state: Any) -> Any:
    """SplitMix64 (Steele, Lea & Flood 2014)."""
    z = state * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@numba.njit
def _gel(
    x: float, y: float, z: float, size: Any, pieces: Any, radius: Any, balls: Any, plugs: Any,
    origin: Any, count: Any, offset: Any, owner: Any,
) -> float:  # fmt: skip
    """Signed distance to the gel's surface, mm: below 0 in the gel, within 0.1 mm right."""
    half = 0.5 * size
    box = max(abs(x - half[0]) - half[0], abs(y - half[1]) - half[1], abs(z - half[2]) - half[2])
    if box > 0.1:
        return box
    i = int((x - origin[0]) / CELL_MM)
    j = int((y - origin[1]) / CELL_MM)
    k = int((z - origin[2]) / CELL_MM)
    if not (0 <= i < count[0] and 0 <= j < count[1] and 0 <= k < count[2]):
        return box
    cell = (i * count[1] + j) * count[2] + k
    lumen = 0.1
    for n in range(offset[cell], offset[cell + 1]):
        p = owner[n]
        if p >= len(pieces):
            ball = balls[p - len(pieces)]
            away = math.sqrt((x - ball[0]) ** 2 + (y - ball[1]) ** 2 + (z - ball[2]) ** 2)
            lumen = min(lumen, away - ball[3])
            continue
        ax, ay, az = pieces[p, 0], pieces[p, 1], pieces[p, 2]
        dx, dy, dz = pieces[p, 3] - ax, pieces[p, 4] - ay, pieces[p, 5] - az
        t = ((x - ax) * dx + (y - ay) * dy + (z - az) * dz) / (dx * dx + dy * dy + dz * dz)
        t = min(1.0, max(0.0, t))
        away = math.sqrt((x - ax - t * dx) ** 2 + (y - ay - t * dy) ** 2 + (z - az - t * dz) ** 2)
        lumen = min(lumen, away - radius[p, 0] - t * (radius[p, 1] - radius[p, 0]))
    for plug in plugs:
        # Gel between two planes across a lumen: middle, direction, half length, reach.
        u, v, w = x - plug[0], y - plug[1], z - plug[2]
        if u * u + v * v + w * w < plug[7] * plug[7]:
            lumen = max(lumen, plug[6] - abs(u * plug[3] + v * plug[4] + w * plug[5]))
    return max(box, -lumen)


@numba.njit
def _share(above: float, below: float) -> float:
    """Share of a straight way on which a distance, linear between its ends, is below 0."""
    if above < 0.0 and below < 0.0:
        return 1.0
    if above >= 0.0 and below >= 0.0:
        return 0.0
    return min(above, below) / (min(above, below) - max(above, below))


@numba.njit(parallel=True)
def _render(
    nx: int, ny: int, nz: int, voxel: Any, to_part: Any, size: Any, pieces: Any, radius: Any,
    balls: Any, plugs: Any, origin: Any, count: Any, offset: Any, owner: Any, numbers: Any,
    looks: int,
    seed: Any,
) -> Any:  # fmt: skip
    out = np.empty((nz, ny, nx), np.uint16)
    counts, attenuation, liquid, noise = numbers
    for row in numba.prange(ny):
        for column in range(nx):
            passed = 1.0
            state = _mixed(seed * np.uint64(0x2545F4914F6CDD1D) + np.uint64(row * nx + column))
            above = 0.0
            for level in range(nz + 1):
                # A beam is thin; along it a voxel counts with its share of gel.
                sx, sy, sz = column * voxel[0], row * voxel[1], (level - 0.5) * voxel[2]
                x = to_part[0, 0] * sx + to_part[0, 1] * sy + to_part[0, 2] * sz + to_part[0, 3]
                y = to_part[1, 0] * sx + to_part[1, 1] * sy + to_part[1, 2] * sz + to_part[1, 3]
                z = to_part[2, 0] * sx + to_part[2, 1] * sy + to_part[2, 2] * sz + to_part[2, 3]
                below = _gel(
                    x, y, z, size, pieces, radius, balls, plugs, origin, count, offset, owner
                )  # fmt: skip
                upper, above = above, below
                if level == 0:
                    continue
                gel = _share(upper, below)
                scatter = gel + (1.0 - gel) * liquid
                lost = math.exp(-attenuation * scatter * voxel[2])
                mean = noise + counts * scatter * passed * lost
                passed *= lost * lost
                product = 1.0
                for _ in range(looks):
                    state += np.uint64(1)
                    product *= ((_mixed(state) >> np.uint64(11)) + np.uint64(1)) * 2.0**-53
                out[level - 1, row, column] = np.uint16(
                    min(65535.0, -mean * math.log(product) / looks + 0.5)
                )
    return out
