"""Find surface points with the deepest tissue below, as roots of trees with wide vessels."""

from __future__ import annotations

import numpy as np

from design.tissue import Tissue
from design.vasculature.growth.surface_points import surface_points
from kernels.arrays import FloatArray

_SAMPLES = 2000
_APART = 0.1

_STEPS = 40


def deep_roots(
    tissue: Tissue, count: int, seed: int, apart: float = _APART
) -> tuple[FloatArray, FloatArray]:
    """Places on the surface below which the tissue is deepest, deepest first.

    A root is as wide as Murray's law makes it, and so are its first branches: a printable tree
    grows as far as they find room. Points are sampled on the surface by area; below each, the
    depth is followed along the inward normal until the line leaves the tissue.

    Parameters
    ----------
    tissue : Tissue
    count : int
        How many at most.
    seed : int
    apart : float
        Least distance of any two, over the diagonal of the tissue's bounds.

    Returns
    -------
    points, directions : (k, 3) float64
        mm, and inward unit normals.
    """
    points, normals = surface_points(tissue, _SAMPLES, np.random.default_rng([seed, 0xDEEB]))
    reach = 2.5 * tissue.grid.deepest_mm
    along = np.linspace(0.0, reach, _STEPS + 1)[1:]
    line = points[:, None] + along[None, :, None] * normals[:, None]
    depth = -tissue.grid.distance(line.reshape(-1, 3)).reshape(line.shape[:2])
    stays = np.logical_and.accumulate(depth > 0, axis=1)
    deepest = np.where(stays, depth, 0.0).max(axis=1)
    least = apart * float(np.linalg.norm(np.ptp(tissue.bounds, axis=0)))
    chosen: list[int] = []
    for n in np.argsort(-deepest, kind="stable"):
        away = np.linalg.norm(points[chosen] - points[n], axis=1)
        if deepest[n] > 0 and (away >= least).all():
            chosen.append(int(n))
        if len(chosen) == count:
            break
    return points[chosen], normals[chosen]
