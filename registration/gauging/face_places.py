"""Places where the scanned outer faces stand out from the design: chips, pits, cavities, excess."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]

_LEAST_UM, _SPREADS = 50.0, 4.0
"""A place's edge is off by this, and by this many robust standard deviations of the faces."""
_DEEPEST = 2.0
"""The worst of it is off by this many times as much: a blur alone rounds a part's edges by less."""
_AREA_MM2 = 0.05
"""Smaller ones are speckle."""
_MOST = 20
"""Listed places."""


def places_off(
    vertices: FloatArray, faces: IntArray, deviation_um: FloatArray
) -> list[dict[str, Any]]:
    """List the connected places that are off the design, largest volume first.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
        Of the scanned surface, part frame.
    faces : (m, 3) int32
    deviation_um : (n,) float64, µm
        Positive where gel is missing; NaN on lumens and where nothing is known.

    Returns
    -------
    list of dict
        Each with ``at_mm`` ([x, y, z], where it is farthest off), ``deviation_um`` (the 95th
        percentile over its area, signed) and ``area_mm2``; at most 20.
    """
    known = deviation_um[np.isfinite(deviation_um)]
    if not len(known):
        return []
    spread = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    limit = max(_LEAST_UM, _SPREADS * spread)
    shares = _areas(vertices, faces)
    found = [
        place
        for side in (deviation_um, -deviation_um)
        for place in _connected(faces, np.nan_to_num(side, nan=-np.inf) > limit)
        if side[place].max() > _DEEPEST * limit and shares[place].sum() > _AREA_MM2
    ]
    found.sort(key=lambda place: -float((shares * np.abs(deviation_um))[place].sum()))
    return [_told(vertices, deviation_um, shares, place) for place in found[:_MOST]]


def _connected(faces: IntArray, off: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Vertices that are off, by the patches that edges join them to."""
    numbers = np.flatnonzero(off)
    new = np.cumsum(off) - 1
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = new[edges[off[edges].all(axis=1)]]
    joined = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(numbers),) * 2)
    _, patch = connected_components(joined, directed=False)
    order = np.argsort(patch, kind="stable")
    if not len(numbers):
        return []
    return np.split(numbers[order], np.flatnonzero(np.diff(patch[order])) + 1)


def _areas(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Each vertex's third of its triangles' areas, (n,), mm²."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.asarray(
        np.bincount(faces.ravel(), np.repeat(third, 3), minlength=len(vertices)), dtype=np.float64
    )


def _told(
    vertices: FloatArray, deviation_um: FloatArray, shares: FloatArray, place: NDArray[np.intp]
) -> dict[str, Any]:
    here = deviation_um[place]
    sign = float(np.sign(here[0]))
    return {
        "at_mm": vertices[place[np.abs(here).argmax()]].round(3).tolist(),
        "deviation_um": round(sign * float(np.percentile(np.abs(here), 95)), 1),
        "area_mm2": round(float(shares[place].sum()), 4),
    }
