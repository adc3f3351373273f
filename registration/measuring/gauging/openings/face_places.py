"""Find connected patches where scanned outer faces are off the design: chips, pits, excess gel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.geometry.surface import Surface
from kernels.arrays import BoolArray, FloatArray

IntArray = NDArray[np.int32]

LEAST_UM, _SPREADS = 50.0, 4.0
"""A place's edge is off by this, and by this many robust standard deviations of the faces."""
_DEEPEST = 2.0
"""The worst of it is off by this many times as much."""
_RIM_BLURS = 2.0
"""An edge may be rounded by this many standard deviations of the blur: half a pixel and the
instrument's own come on top of the 0.5 to 0.8 by which the blur of the work rounds it."""
_AREA_MM2 = 0.05
"""Smaller ones are speckle."""
_MOST = 20
"""Listed places."""


@dataclass(frozen=True)
class FacePlace:
    """A connected place where the scanned surface is off the design, away from lumens.

    Attributes
    ----------
    at_mm : (x, y, z), mm
        Where it is farthest off, part frame.
    deviation_um : float, µm
        The 95th percentile over its area, positive where gel is missing.
    area_mm2 : float, mm²
    """

    at_mm: tuple[float, float, float]
    deviation_um: float
    area_mm2: float


@dataclass(frozen=True)
class ScannedFaces:
    """The scanned surface away from lumens.

    Attributes
    ----------
    surface : Surface
        Part frame.
    deviation_um : (n,) float64, µm
        Positive where gel is missing; NaN on lumens, where nothing is known, and where it is less
        than `LEAST_UM` and so doesn't count.
    near_rims : (n,) bool
        Beside sharp edges, which a blur rounds.
    blur_um, spread_um : float, µm
        The blur's standard deviation, and the robust one of all deviations of these faces.
    """

    surface: Surface
    deviation_um: FloatArray
    near_rims: BoolArray
    blur_um: float
    spread_um: float

    def places_off(self) -> tuple[FacePlace, ...]:
        """List the connected places that are off the design, largest volume first; at most 20."""
        off = self.deviation_um
        off = np.sign(off) * (np.abs(off) - np.where(self.near_rims, _RIM_BLURS * self.blur_um, 0))
        off = np.where(off * self.deviation_um > 0, off, 0.0)
        limit = max(LEAST_UM, _SPREADS * self.spread_um)
        faces = self.surface.faces[np.isfinite(self.deviation_um)[self.surface.faces].any(axis=1)]
        shares = _areas(self.surface.vertices, faces)
        places = [
            place
            for side in (off, -off)
            for place in _connected(faces, np.nan_to_num(side, nan=0.0) > limit)
            if side[place].max() > _DEEPEST * limit and shares[place].sum() > _AREA_MM2
        ]
        volume = shares * np.abs(self.deviation_um)
        places.sort(key=lambda place: -float(volume[place].sum()))
        return tuple(self._place_of(place, shares) for place in places[:_MOST])

    def _place_of(self, place: NDArray[np.intp], shares: FloatArray) -> FacePlace:
        here = self.deviation_um[place]
        x, y, z = self.surface.vertices[place[np.abs(here).argmax()]].round(3).tolist()
        size = float(np.sign(here[0]) * np.percentile(np.abs(here), 95))
        return FacePlace((x, y, z), round(size, 1), round(float(shares[place].sum()), 4))


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
