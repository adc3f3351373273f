"""How wide a way through the gel is: by how much gel is missing across it.

The area of a cut is the integral of what evidence lacks there, over what it lacks in liquid; no
blur changes an integral, so that a way as narrow as the resolution is measured too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from registration.alignment import Fit
from registration.segmentation.evidence import GelEvidence
from registration.topology.ways import Scene

FloatArray = NDArray[np.float64]

_REACH_MM = (0.16, 0.5)
"""Discs are at least and at most so large in radius."""
_BEYOND_MM = 0.1
"""And reach so far beyond the way: blur and a crooked path."""
_ROUNDS = 4
_STEP_MM = 0.02


def width(path: FloatArray, scene: Scene, evidence: GelEvidence, fit: Fit) -> tuple[float, float]:
    """Return the diameter of a way and half its 95 % interval, mm.

    Parameters
    ----------
    path : (n, 3) float64, mm
        From wall to wall, part frame.
    scene : Scene
        Design on a grid: only what is gel by design counts.
    evidence : GelEvidence
    fit : Fit
        Scan to part.
    """
    centre, tangent = _cuts(path)
    radius, area = 0.25, np.zeros(len(centre))
    for _ in range(_ROUNDS):
        area = _areas(centre, tangent, radius, scene, evidence, fit)
        half = float(np.sqrt(max(np.nanmean(area), 0.0) / np.pi)) if np.isfinite(area).any() else 0.0
        radius = float(np.clip(half + _BEYOND_MM, *_REACH_MM))
    area = area[np.isfinite(area)]
    if not len(area):
        return scene.grid.step_mm, scene.grid.step_mm
    mean = max(float(area.mean()), np.pi * (scene.grid.step_mm / 2) ** 2)
    spread = float(area.std(ddof=1)) if len(area) > 1 else mean
    diameter = 2 * float(np.sqrt(mean / np.pi))
    # d = 2 √(A/π), so that its relative error is half the area's.
    return diameter, 1.96 * diameter * spread / np.sqrt(len(area)) / (2 * mean)


def _cuts(path: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places 0.1 mm apart along a smoothed path, and its direction there."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(2, int(along[-1] / 0.1) + 1)
    even = np.linspace(along[0], along[-1], count)
    # A voxel path zigzags: a parabola through all of it doesn't.
    order = min(2, len(path) - 1)
    fits = [np.polynomial.Polynomial.fit(along, path[:, k], order) for k in range(3)]
    centre = np.stack([f(even) for f in fits], axis=1)
    tangent = np.stack([f.deriv()(even) for f in fits], axis=1)
    return centre, tangent / np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)


def _areas(
    centre: FloatArray,
    tangent: FloatArray,
    radius: float,
    scene: Scene,
    evidence: GelEvidence,
    fit: Fit,
) -> FloatArray:
    """Area free of gel in discs across a way, (n,), mm²; NaN where less than half is gel by design."""
    side = np.arange(-radius, radius + _STEP_MM / 2, _STEP_MM)
    flat = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    flat = flat[(flat**2).sum(axis=1) <= radius**2]
    helper = np.where(np.abs(tangent[:, 2:]) < 0.8, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, tangent)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    places = centre[:, None] + flat[:, :1] * first[:, None] + flat[:, 1:] * second[:, None]
    share = evidence.fine_at(fit.invert(places.reshape(-1, 3))).reshape(places.shape[:2])
    grid = scene.grid
    index = np.round((places - grid.origin_mm) / grid.step_mm).astype(np.int64)[..., ::-1]
    index = np.clip(index, 0, np.array(grid.free.shape) - 1)
    counts = scene.gel[tuple(np.moveaxis(index, -1, 0))] & np.isfinite(share)
    lacking = np.where(counts, (1 - share) / (1 - scene.liquid), 0.0)
    inside = counts.mean(axis=1)
    area = lacking.sum(axis=1) * _STEP_MM**2
    return np.where(inside >= 0.5, area, np.nan)
