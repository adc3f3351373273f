"""Check that a triangle surface is closed and oriented; compute its volume."""

from __future__ import annotations

from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.mesh import Edges, edges_of, merge_vertices
from design.geometry.surface import Surface
from kernels import jit
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int32]


def merged_surface(
    vertices: FloatArray, faces: NDArray[np.integer]
) -> tuple[FloatArray, FaceArray]:
    """As `merge_vertices`; raise `TissueError` where there are no faces."""
    if len(faces) == 0 or len(vertices) == 0:
        raise TissueError("mesh is empty: it has no faces; give a closed surface")
    points, corners = merge_vertices(vertices, faces)
    return points, corners.astype(np.int32)


def check_closed(points: FloatArray, faces: FaceArray) -> None:
    """Raise `TissueError` with counts and places unless ``faces`` are closed and agree."""
    edges = edges_of(faces)
    if edges.open:
        raise TissueError(
            f"mesh is open: {edges.open} of {len(edges.uses)} edges aren't shared by two faces "
            f"({_places(points, edges, edges.uses % 2 == 1)}); close the holes (for example with "
            "a mesh repair tool) and try again"
        )
    if edges.turned:
        raise TissueError(
            f"mesh isn't consistently oriented: at {edges.turned} of {len(edges.uses)} edges two "
            f"faces look opposite ways ({_places(points, edges, edges.balance != 0)}); make the "
            "normals consistent and try again"
        )


def _places(points: FloatArray, edges: Edges, chosen: NDArray[np.bool_]) -> str:
    middles = points[edges.ends[chosen]].mean(axis=1)
    return format_points(middles)


def format_points(points: FloatArray, most: int = 3) -> str:
    """A few of ``points`` (n, 3), for messages; in the points' own unit."""
    shown = ", ".join(f"({x:.4g}, {y:.4g}, {z:.4g})" for x, y, z in points[:most])
    return f"near {shown}" + (f" and {len(points) - most} more" if len(points) > most else "")


def enclosed_volume(points: FloatArray, faces: NDArray[np.integer]) -> float:
    """Enclosed volume by the divergence theorem; negative when the faces look inward."""
    a, b, c = (points[faces[:, k]] - points.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def face_areas(points: FloatArray, faces: NDArray[np.integer]) -> FloatArray:
    """Area of each face, (m,)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    areas: FloatArray = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


# Each lattice cell is parted into six tetrahedra around one diagonal (Kuhn 1960), alike in every
# cell, so that neighbours agree on their common face. The surface is closed and oriented by
# construction wherever the field's rim is outside, which marching cubes with its ambiguous faces
# isn't (Doi & Koide 1991).
_LEAST = 0.02
"""Of an edge, between a vertex of the surface and a lattice node: all vertices stay distinct."""

# Even orders of a tetrahedron's corners that bring those inside to the front.
_ONE = ((0, 1, 2, 3), (1, 0, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0))
_TWO = ((0, 1, 2, 3), (0, 2, 3, 1), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 2, 0), (2, 3, 0, 1))


def isosurface(values: NDArray[np.floating], level: float) -> Surface:
    """The surface around the places where ``values`` exceed ``level``.

    Parameters
    ----------
    values : (a, b, c) float
        At the nodes of a lattice; at most ``level`` all around the rim, or the surface is open
        there.
    level : float

    Returns
    -------
    Surface
        In lattice indices; without faces where no value exceeds the level.
    """
    field = np.ascontiguousarray(values, dtype=np.float64)
    keys = _march(field, level, _COUNT, _EDGES)
    edges, index = np.unique(keys.ravel(), return_inverse=True)
    node, direction = edges // 8, edges % 8
    begin = np.stack(np.unravel_index(node, field.shape), axis=1)
    way = (direction[:, None] >> np.arange(3)) & 1
    end = begin + way
    one, two = field[tuple(begin.T)], field[tuple(end.T)]
    along = np.clip((level - one) / (two - one), _LEAST, 1.0 - _LEAST)
    return Surface(begin + along[:, None] * way, index.reshape(-1, 3).astype(np.int32))


def _cases() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles of each of six tetrahedra and sixteen patterns of corners inside.

    Corner k of a cell has bit 0 of k for x, bit 1 for y, bit 2 for z.
    """
    count = np.zeros((6, 17), dtype=np.int64)
    edges = np.zeros((6, 16, 2, 3, 2), dtype=np.int64)
    for tet, axes in enumerate(permutations(range(3))):
        corners = [0, 1 << axes[0], (1 << axes[0]) | (1 << axes[1]), 7]
        turned = bool(np.linalg.det(np.eye(3)[list(axes)]) < 0)
        for mask in range(1, 15):
            triangles = _triangles(mask)
            count[tet, mask] = len(triangles)
            for n, triangle in enumerate(triangles):
                order = triangle[::-1] if turned else triangle
                edges[tet, mask, n] = [sorted(corners[k] for k in edge) for edge in order]
        count[tet, 16] = sum(c << (4 * k) for k, c in enumerate(corners))
    return count, edges


def _triangles(mask: int) -> list[list[tuple[int, int]]]:
    """Triangles between the corners in ``mask`` and the others, seen from outside; as edges."""
    inside = [k for k in range(4) if mask >> k & 1]
    if len(inside) == 3:
        return [triangle[::-1] for triangle in _triangles(15 - mask)]
    if len(inside) == 1:
        a, b, c, d = _ONE[inside[0]]
        return [[(a, b), (a, c), (a, d)]]
    a, b, c, d = next(order for order in _TWO if set(order[:2]) == set(inside))
    return [[(a, c), (a, d), (b, d)], [(a, c), (b, d), (b, c)]]


_COUNT, _EDGES = _cases()


@jit
def _march(field: Any, level: float, count: Any, edges: Any) -> Any:
    """Edges of the lattice that each triangle's corners lie on: 8 x node + direction's bits."""
    na, nb, nc = field.shape
    step = np.array((nb * nc, nc, 1))
    node = np.empty(8, np.int64)
    keys = np.empty((0, 3), np.int64)
    # Counted first, then written: the list needs no growing.
    for fill in range(2):
        at = 0
        for i in range(na - 1):
            for j in range(nb - 1):
                for k in range(nc - 1):
                    base = (i * nb + j) * nc + k
                    mask = 0
                    for c in range(8):
                        x, y, z = i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)
                        node[c] = base + (c & 1) * step[0] + (c >> 1 & 1) * step[1] + (c >> 2)
                        if field[x, y, z] > level:
                            mask |= 1 << c
                    if mask == 0 or mask == 255:
                        continue
                    for tet in range(6):
                        packed = count[tet, 16]
                        inside = 0
                        for c in range(4):
                            inside |= (mask >> (packed >> 4 * c & 15) & 1) << c
                        for n in range(count[tet, inside]):
                            if fill == 1:
                                for e in range(3):
                                    low, high = edges[tet, inside, n, e]
                                    keys[at, e] = 8 * node[low] + (high - low)
                            at += 1
        if fill == 0:
            keys = np.empty((at, 3), np.int64)
    return keys
