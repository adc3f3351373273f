"""Flow and pressure through plane cuts of quadratic tetrahedra, read from a VTU file alone.

Reads with meshio and interpolates by itself: it shares nothing with what wrote the file.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import meshio
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]

_REACH = 6.0
"""How far from its centre a cut's elements are looked for, in radii."""

_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
_PARTS = np.array([[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 9, 8],
                   [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]])  # fmt: skip
"""Tetrahedra within one, by its corners and edges' middles."""


def _split(corner: FloatArray) -> FloatArray:
    """Eight parts (8, 4, 3) of a tetrahedron (4, 3)."""
    return np.vstack([corner, [corner[list(edge)].mean(axis=0) for edge in _EDGES]])[_PARTS]


_PLACES = np.concatenate([_split(c) for c in _split(np.vstack([np.zeros(3), np.eye(3)]))])
"""64 parts of the reference element, each taken as straight: (64, 4, 3)."""

_TRIANGLES = (
    (1, ((0, 1), (0, 2), (0, 3))), (3, ((3, 0), (3, 1), (3, 2))),
    (2, ((0, 2), (0, 3), (1, 3))), (2, ((0, 2), (1, 3), (1, 2))),
)  # fmt: skip
"""Corners above a plane, and edges that it cuts, corners sorted from the highest."""


class Cut(NamedTuple):
    """Area, mm², flow along the direction, µL/s, mean pressure, Pa, and peak velocity, mm/s."""

    area: float
    flow: float
    pressure: float
    fastest: float

    @property
    def parabola_flow(self) -> float:
        """Flow of a parabolic profile with this peak, v_max A / 2, µL/s."""
        return 0.5 * self.fastest * self.area


def entrance_length_mm(radius: float, reynolds: float) -> float:
    """Return the length within which a uniform profile turns parabolic in a pipe, mm.

    Durst et al. 2005, doi 10.1115/1.2063088: L / D = (0.619^1.6 + (0.0567 Re)^1.6)^(1 / 1.6).
    """
    return 2.0 * radius * (0.619**1.6 + (0.0567 * reynolds) ** 1.6) ** (1.0 / 1.6)


class VtuFlow:
    """A file's mesh, velocity and pressure."""

    def __init__(self, path: Path) -> None:
        found = meshio.read(path)
        self.points = np.asarray(found.points, dtype=np.float64)
        self.cells = found.cells_dict["tetra10"]
        names = {name.lower(): name for name in found.point_data}
        self.velocity = found.point_data[next(names[n] for n in names if n.startswith("velocity"))]
        pressure = found.point_data[next(names[n] for n in names if n.startswith("pressure"))]
        self.pressure = pressure.reshape(-1, 1)
        self.tree = cKDTree(self.points[self.cells[:, :4]].mean(axis=1))

    def section(self, centre: FloatArray, along: FloatArray, radius: float) -> Cut:
        """Cut square to ``along``: the part that hangs together round the centre."""
        cells = self.cells[self.tree.query_ball_point(centre, _REACH * radius)]
        beyond = (self.points[cells] - centre) @ along
        met = (beyond.min(axis=1) < 0.0) & (beyond.max(axis=1) > 0.0)
        at, owner = _polygons(beyond[met])
        cells = cells[met][owner]
        corner = _values(self.points[cells], at)
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        part = _hanging_together(cells[:, :4])
        mine = part == part[np.linalg.norm(corner.mean(axis=1) - centre, axis=1).argmin()]
        area = np.where(mine, 0.5 * np.linalg.norm(normal, axis=1), 0.0)
        # Exact for quadratics: the middles of a triangle's edges.
        middle = 0.5 * (at + np.roll(at, -1, axis=1))
        speed = _values(self.velocity[cells], middle) @ along
        pressure = _values(self.pressure[cells], middle).mean(axis=(1, 2))
        # The middles of triangles a quarter of an element wide come within 0.5 % of the peak.
        found = area.sum(), area @ speed.mean(axis=1), area @ pressure / area.sum()
        peak = speed[mine].flat[np.abs(speed[mine]).argmax()]
        return Cut(*map(float, (*found, peak)))


def _polygons(beyond: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Reference corners (m, 3, 3) of triangles where nodes' heights (t, 10) are 0; elements."""
    height = (beyond @ _shapes(_PLACES.reshape(-1, 3)).T).reshape(-1, 4)
    order = np.argsort(-height, axis=1)
    height = np.take_along_axis(height, order, axis=1)
    place = np.take_along_axis(np.tile(_PLACES, (len(beyond), 1, 1)), order[..., None], axis=1)
    corners, owners = [], []
    for above, edges in _TRIANGLES:
        mine = np.flatnonzero((height > 0.0).sum(axis=1) == above)
        first, last = np.array(edges).T
        high, low = height[mine][:, first], height[mine][:, last]
        start, end = place[mine][:, first], place[mine][:, last]
        corners.append(start + (high / (high - low))[..., None] * (end - start))
        owners.append(mine // len(_PLACES))
    return np.concatenate(corners), np.concatenate(owners)


def _values(nodal: FloatArray, at: FloatArray) -> FloatArray:
    """Values (m, q, k) at reference places (m, q, 3) of elements with nodal ones (m, 10, k)."""
    shape = _shapes(at.reshape(-1, 3)).reshape(*at.shape[:2], 10)
    return np.asarray(np.einsum("mqn,mnk->mqk", shape, nodal))


def _shapes(at: FloatArray) -> FloatArray:
    """VTK's quadratic tetrahedron, (p, 10)."""
    one = np.column_stack([1.0 - at.sum(axis=1), at])
    value = [one[:, i] * (2.0 * one[:, i] - 1.0) for i in range(4)]
    return np.stack([*value, *(4.0 * one[:, i] * one[:, j] for i, j in _EDGES)], axis=1)


def _hanging_together(corner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Label of the part that each element (m, 4) belongs to."""
    name = np.unique(corner, return_inverse=True)[1].reshape(corner.shape)
    pairs = np.concatenate([name[:, edge] for edge in combinations(range(4), 2)])
    size = int(name.max()) + 1
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1][name[:, 0]])
