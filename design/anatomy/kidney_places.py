"""Find a kidney's hilum (vessel entry), capsule and cortex thickness from its shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from design.tissue import Tissue
from kernels.arrays import FloatArray

_SINUS = 0.03
"""Share of the surface, the least open of it, that is the sinus at least."""

CORTEX = 1.0 / 3.0
"""Thickness of the cortex over the greatest depth below the capsule, where it isn't given."""


@dataclass(frozen=True)
class KidneyPlaces:
    """Places of a kidney.

    Attributes
    ----------
    entry, inward : (3,) float64
        Where the vessels enter, mm, on the wall of the sinus; and which way, a unit vector.
    hilum : (3,) float64
        Unit vector out of the hilum.
    capsule : (k, 3) float64, mm
        Places of the outer surface.
    cortex_mm : float, mm
    """

    entry: FloatArray
    inward: FloatArray
    hilum: FloatArray
    capsule: FloatArray
    cortex_mm: float

    def below_capsule(self, points: FloatArray) -> FloatArray:
        """Depth (n,) of points (n, 3) below the capsule, the sinus's wall left out of account."""
        depth: FloatArray = cKDTree(self.capsule).query(points)[0]
        return depth

    def kept_in_medulla(self, points: FloatArray) -> FloatArray:
        """Points (n, 3), those in the cortex moved to its inner border."""
        away, near = cKDTree(self.capsule).query(points)
        from_there = points - self.capsule[near]
        short = np.maximum(self.cortex_mm - away, 0.0)
        moved: FloatArray = points + (short / np.maximum(away, 1e-9))[:, None] * from_there
        return moved


def find_kidney_places(
    tissue: Tissue,
    samples: SurfaceSamples,
    volume: FloatArray,
    entry: FloatArray | None = None,
    cortex_mm: float | None = None,
) -> KidneyPlaces:
    """Find the hilum where the surface is least open, and the cortex below all the rest.

    Parameters
    ----------
    volume : (k, 3) float64, mm
        Points all over the tissue.
    entry : (3,) float64, mm, optional
        Near where the vessels enter; else the middle of the sinus.

    Raises
    ------
    TissueError
        Where the surface is as open everywhere, and no entry is given.
    """
    least = float(np.quantile(samples.openness, _SINUS))
    inner = samples.openness <= max(min(0.5, 0.97 * samples.openness.max()), least)
    if inner.mean() > 0.5:
        inner = samples.openness <= least
    if inner.mean() > 0.5:
        if entry is None:
            raise TissueError(
                "no hilum is found: the surface is as open everywhere; give the place where the "
                "vessels enter (anatomy: {inlets: {hilum: {at_mm: [x, y, z]}}})"
            )
        away = np.linalg.norm(samples.points - entry, axis=1)
        inner = away <= np.quantile(away, _SINUS)
    capsule = samples.points[~inner]
    middle = samples.points[inner].mean(axis=0)
    target = middle if entry is None else entry
    inside = np.flatnonzero(inner)
    at = int(inside[np.argmin(np.linalg.norm(samples.points[inside] - target, axis=1))])
    if entry is not None:
        at = int(np.argmin(np.linalg.norm(samples.points - entry, axis=1)))
    out = samples.way_out[inner].sum(axis=0)
    if not np.linalg.norm(out) > 0.0:
        out = -samples.inward[at]  # of a sinus so narrow that no ray leaves it
    depth = cKDTree(capsule).query(volume)[0]
    return KidneyPlaces(
        samples.points[at],
        samples.inward[at],
        out / np.linalg.norm(out),
        capsule,
        cortex_mm if cortex_mm is not None else CORTEX * float(depth.max()),
    )
