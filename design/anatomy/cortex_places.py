"""Find a cortex's pial (outer) side, its mean outward direction and thickness from its shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from design.tissue import Tissue
from kernels.arrays import FloatArray, IntArray

_NEIGHBOURS = 12
_SAME_SIDE = 0.7
"""Cosine between normals of neighbours on one side; rims are sharper."""

_SHEET = 0.2
"""Thickness over the extent above which a shape is no sheet: all its surface is pial."""


_ALL_WAYS = 0.1
"""Length of a side's mean normal below which it looks all ways."""

_ALIKE = 0.95
"""Share of the larger side from which on two count as equally large."""


@dataclass(frozen=True)
class CortexPlaces:
    """Places of a cortex.

    Attributes
    ----------
    pial : (k,) int64
        Numbers of the surface samples on the pial side.
    outward : (3,) float64
        Mean normal of that side, a unit vector.
    thickness_mm : float
        Median along the normal, or as it is given.
    closed : bool
        Whether that side looks all ways, as a hemisphere's does: it has no mean normal.
    """

    pial: IntArray
    outward: FloatArray
    thickness_mm: float
    closed: bool = False


def find_cortex_places(
    tissue: Tissue,
    samples: SurfaceSamples,
    direction: FloatArray | None = None,
    thickness_mm: float | None = None,
) -> CortexPlaces:
    """Find the pial side: the larger side of a sheet, or that of a direction.

    Of two equally large ones (a slab) the one that looks up.

    Parameters
    ----------
    direction : (3,) float64, optional
        Out of the pial side.
    thickness_mm : float, optional
        Of the grey matter, where the shape is thicker.

    Raises
    ------
    TissueError
        When the sides can't be told apart.
    """
    every = depth_along_normal(tissue, samples.points, samples.inward)
    sides = _sides(samples, every)
    if not all(len(side) for side in sides):
        raise TissueError(
            "the two sides of the sheet can't be told apart; the mesh may be too rough for a cortex"
        )
    normal = [-samples.inward[side].sum(axis=0) for side in sides]
    if direction is not None:
        best = int(np.argmax([each @ direction for each in normal]))
    else:
        size = np.array([len(side) for side in sides])
        alike = size >= _ALIKE * size.max()
        best = int(np.argmax(np.where(alike, [each[2] for each in normal], -np.inf)))
    pial = sides[best]
    deep = every[pial]
    outward = normal[best]
    length = float(np.linalg.norm(outward))
    return CortexPlaces(
        pial,
        outward / max(length, 1e-12),
        float(np.median(deep)) if thickness_mm is None else thickness_mm,
        length < _ALL_WAYS * len(pial),
    )


def depth_along_normal(tissue: Tissue, points: FloatArray, inward: FloatArray) -> FloatArray:
    """Way (n,) from surface points (n, 3) along ``inward`` (n, 3) to where they leave, mm."""
    least = 0.25 * tissue.grid.spacing_mm
    low, high = tissue.bounds
    far = float(np.linalg.norm(high - low))
    gone = np.full(len(points), 4.0 * least)
    going = np.arange(len(points))
    while len(going):
        room = -tissue.grid.distance(points[going] + gone[going, None] * inward[going])
        on = (room > 0.0) & (gone[going] < far)
        gone[going[on]] += np.maximum(room[on], least)
        going = going[on]
    return gone


def _sides(samples: SurfaceSamples, deep: FloatArray) -> list[IntArray]:
    """Samples of each side of a sheet; of a solid body all samples, as one."""
    points, inward = samples.points, samples.inward
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if np.median(deep) > _SHEET * extent:
        return [np.arange(len(points))]
    index = cKDTree(points)
    near = index.query(points, _NEIGHBOURS)[1]
    same = np.einsum("nkx,nx->nk", inward[near], inward) > _SAME_SIDE
    away, across = index.query(points + deep[:, None] * inward)
    facing = np.einsum("nx,nx->n", inward, inward[across])
    # From the place that faces its other side best, on both sides at once: rims come last.
    side = np.zeros(len(points), dtype=np.int64)
    thin = deep <= 1.1 * np.median(deep)
    seed = int(np.argmin(np.where(thin, facing + away / np.median(deep), np.inf)))
    side[seed], side[across[seed]] = 1, -1
    queue = [seed, int(across[seed])]
    for here in queue:
        for there in near[here][same[here]].tolist():
            if side[there]:
                continue
            side[there] = side[here]
            queue.append(there)
            other = int(across[there])
            if not side[other] and facing[there] < -_SAME_SIDE:
                side[other] = -side[here]
                queue.append(other)
    return [np.flatnonzero(side == 1), np.flatnonzero(side == -1)]
