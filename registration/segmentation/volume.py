"""Data classes of a segmented scan: gel field with threshold, OCT signal; trilinear sampling."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import FloatArray

Volume = NDArray[np.float32] | NDArray[np.uint16]


@dataclass(frozen=True)
class GelField:
    """A smoothed volume in which gel lies above `level` and lumen or liquid below.

    Attributes
    ----------
    values : (nz, ny, nx) float32 or uint16
        Grey values; `sign` turned so that gel is high.
    level : float
        The surface lies where ``sign * value == level``.
    sign : float
        1, or -1 where lumens are brighter than gel.
    voxel_mm : (3,) float64, mm
        Geometric, as x, y, z.
    origin_mm : (3,) float64, mm
        Centre of voxel (0, 0, 0) in the scan's frame, as x, y, z.
    blur_mm : float, mm
        Standard deviation of what binning and smoothing have blurred (not the instrument).
    wall_mm : float, mm
        How much further into the gel walls truly lie than where the level is crossed.
    faint_mm : float, mm
        Part of `wall_mm` that takes half of the faintest reflections off, as if walls had ledges
        all over.
    facing_mm : float, mm
        The same, for walls that face the light or away from it, beyond `wall_mm`; walls along the
        light have none of it, and between it goes with the square of the normal's part along z.
    uneven : float
        Standard deviation of the gel's own level, of the step from liquid to gel (`unevenness`).
    """

    values: Volume
    level: float
    sign: float
    voxel_mm: FloatArray
    origin_mm: FloatArray
    blur_mm: float
    wall_mm: float = 0.0
    faint_mm: float = 0.0
    facing_mm: float = 0.0
    uneven: float = 0.0

    def above_level(self, points: FloatArray) -> FloatArray:
        """``sign * value - level`` at (..., 3) scan positions; NaN outside the field of view."""
        where = (np.asarray(points, dtype=np.float64) - self.origin_mm) / self.voxel_mm
        flat = np.ascontiguousarray(where.reshape(-1, 3))
        return self.sign * sample(self.values, flat).reshape(where.shape[:-1]) - self.level


@dataclass(frozen=True)
class Strength:
    """Binned OCT signal less its noise floor, to tell what light still reached.

    Attributes
    ----------
    signal : (nz, ny, nx) float32
        On the voxels of the gel field.
    noise : float
        The floor that was taken off.
    share : (nz, ny, nx) float16
        Share of gel, 1 where there is gel alone, speckle and reflections and all.
    dark : float
        Brightness of liquid over that of gel.
    """

    signal: NDArray[np.float32]
    noise: float
    share: NDArray[np.float16]
    dark: float = 0.0


@jit
def trilinear(values: Volume, x: float, y: float, z: float) -> float:
    """Trilinear value at a position in voxels; NaN outside."""
    nz, ny, nx = values.shape
    if not (0.0 <= x <= nx - 1 and 0.0 <= y <= ny - 1 and 0.0 <= z <= nz - 1):
        return math.nan
    i, j, k = min(int(x), nx - 2), min(int(y), ny - 2), min(int(z), nz - 2)
    u, v, w = x - i, y - j, z - k
    a = values[k, j, i] * (1 - u) + values[k, j, i + 1] * u
    b = values[k, j + 1, i] * (1 - u) + values[k, j + 1, i + 1] * u
    c = values[k + 1, j, i] * (1 - u) + values[k + 1, j, i + 1] * u
    d = values[k + 1, j + 1, i] * (1 - u) + values[k + 1, j + 1, i + 1] * u
    return float((a * (1 - v) + b * v) * (1 - w) + (c * (1 - v) + d * v) * w)


@jit
def sample(values: Volume, points: FloatArray) -> FloatArray:
    """Trilinear values at (n, 3) positions x, y, z in voxels; NaN outside."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = trilinear(values, points[i, 0], points[i, 1], points[i, 2])
    return out
