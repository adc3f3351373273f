"""Check that a triangle surface is closed and oriented; compute its volume."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int32]


class Edges(NamedTuple):
    """The undirected edges of a surface.

    Attributes
    ----------
    ends : (e, 2) int64
        Vertices, the lower number first.
    uses : (e,) int64
        Faces at each.
    balance : (e,) int64
        Faces that pass it upwards less those that pass it downwards; 0 where all agree.
    of_face : (3 m,) int64
        Edge of each face's three sides, face by face.
    """

    ends: NDArray[np.int64]
    uses: NDArray[np.int64]
    balance: NDArray[np.int64]
    of_face: NDArray[np.int64]

    def sides(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sides of faces, edge by edge, (3 m,), and where those of each edge begin, (e,)."""
        first = np.concatenate([[0], np.cumsum(self.uses)[:-1]])
        return np.argsort(self.of_face, kind="stable"), first

    @property
    def open(self) -> int:
        """Edges with an odd number of faces."""
        return int((self.uses % 2 == 1).sum())

    @property
    def turned(self) -> int:
        """Edges whose faces disagree on what is outside."""
        return int(((self.balance != 0) & (self.uses % 2 == 0)).sum())


def edges_of(faces: NDArray[np.integer]) -> Edges:
    """Edges of ``faces`` (m, 3)."""
    one = faces.ravel().astype(np.int64)
    two = faces[:, [1, 2, 0]].ravel().astype(np.int64)
    size = int(faces.max(initial=0)) + 1
    low, high = np.minimum(one, two), np.maximum(one, two)
    keys, of_face, uses = np.unique(low * size + high, return_inverse=True, return_counts=True)
    upward = np.where(one < two, 1, -1)
    balance = np.bincount(of_face, weights=upward, minlength=len(keys)).astype(np.int64)
    ends = np.stack([keys // size, keys % size], axis=1)
    return Edges(ends, uses, balance, of_face)


def merge_vertices(
    vertices: FloatArray, faces: NDArray[np.integer]
) -> tuple[FloatArray, FaceArray]:
    """Vertices used by faces, each once, and faces without repeated corners.

    Raises
    ------
    TissueError
        When there are none.
    """
    if len(faces) == 0 or len(vertices) == 0:
        raise TissueError("mesh is empty: it has no faces; give a closed surface")
    points, number = unique_rows(vertices[faces.ravel()])
    corners = number.reshape(-1, 3).astype(np.int32)
    repeated = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    return np.ascontiguousarray(points), np.ascontiguousarray(corners[~repeated])


def unique_rows(rows: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Distinct rows (k, 3) in lexicographic order, and which of them each row is, (n,).

    As `numpy.unique` along an axis, whose sort of records takes four times as long.
    """
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    new = np.concatenate([[True], (ordered[1:] != ordered[:-1]).any(axis=1)])
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return np.ascontiguousarray(ordered[new]), number


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
