"""Paint an OCT volume of a layer with known ink: speckle, attenuation, a leaning layer."""

import numpy as np

from benchmarks.checkers.layer_painter import Plan, thickness

VOXEL = (0.01, 0.02, 0.02)
SHAPE = (100, 500, 500)
LEAN_MM = 0.05
DEPTH_MM = 0.5


def paint_volume(
    plan: Plan,
    ink: tuple[np.ndarray, ...],
    gaps: list[tuple[int, float, float]],
    rng: np.random.Generator,
    shape: tuple[int, int, int] = SHAPE,
) -> tuple[np.ndarray, np.ndarray]:
    """Volume (100, 500, 500) uint16, and the matrix from the printer (layer at z 0.3) to it, mm."""
    origin = np.array([9.5, 19.5])
    at, stroke, along, width = ink
    rel, radius = thickness(at, stroke, along, width, gaps, origin, VOXEL[1], shape[1:])
    half = np.where(rel < 1, radius * np.sqrt(np.clip(1 - rel**2, 0, 1)), 0)
    lean = LEAN_MM * np.arange(shape[2])[None, :] / shape[2]
    volume = np.empty(shape, np.uint16)
    for k in range(shape[0]):
        z = k * VOXEL[0] - DEPTH_MM - lean
        inside = np.abs(z) < half
        mean = 60 + 1000 * inside * np.exp(-1.4 * np.clip(z + half, 0, 1))
        volume[k] = np.minimum(rng.gamma(3.0, mean / 3.0), 65_535)
    slope = LEAN_MM / (shape[2] * VOXEL[2])
    return volume, np.array(
        [
            [1, 0, 0, -origin[0]],
            [0, 1, 0, -origin[1]],
            [slope, 0, -1, DEPTH_MM - slope * origin[0] + 0.3],
            [0, 0, 0, 1.0],
        ]
    )
