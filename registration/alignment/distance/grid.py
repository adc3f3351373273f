"""Dense grid of signed distances, for fast approximate look-up in coarse alignment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment.distance.surface import ModelSurface


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distances at grid points.

    Attributes
    ----------
    values : (nz, ny, nx) float32, mm
        Positive outside.
    origin_mm : (3,) float64, mm
        Position of value (0, 0, 0), as x, y, z.
    step_mm : float, mm
        Between grid points.
    """

    values: NDArray[np.float32]
    origin_mm: FloatArray
    step_mm: float


def distance_grid(
    surface: ModelSurface, margin_mm: float, finest_mm: float, most: int = 300_000
) -> DistanceGrid:
    """Exact distances on a grid over the surface's box and a margin.

    The step is `finest_mm`, or as coarse as `most` grid points demand.
    """
    low, high = surface.bounds[0] - margin_mm, surface.bounds[1] + margin_mm
    step = max(finest_mm, float((np.prod(high - low) / most) ** (1 / 3)))
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    values = surface.query(points).distance.astype(np.float32).reshape(x.shape)
    return DistanceGrid(values, low, step)
