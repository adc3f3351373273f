"""Drop duplicate faces of a mesh and weld the vertices along narrow gaps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.geometry.mesh import connected_parts, edges_of
from design.tissue.closed import FaceArray, merged_surface
from design.tissue.mesh_repair.holes import open_sides
from design.tissue.mesh_repair.limits import LIMITS
from kernels.arrays import FloatArray


def drop_duplicates(faces: FaceArray) -> tuple[FaceArray, int]:
    """Keep one of each set of faces with the same corners, unless that opens edges.

    Where as many look one way as the other, two solids meet: the wall between them goes, if that
    leaves fewer edges open.
    """
    key = np.sort(faces, axis=1)
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(faces):
        return faces, 0
    group = group.ravel()
    looks = np.bincount(group, weights=_way_round(faces, key), minlength=len(first))
    once, no_walls = faces[np.sort(first)], faces[np.sort(first[looks != 0])]
    fewer = min((once, no_walls), key=_faults)
    if edges_of(fewer).open > edges_of(faces).open:
        return faces, 0
    return fewer, len(faces) - len(fewer)


def _faults(faces: FaceArray) -> tuple[bool, int, int]:
    edges = edges_of(faces)
    return len(faces) == 0, edges.open, edges.turned


def _way_round(faces: FaceArray, key: FaceArray) -> NDArray[np.int64]:
    """+1 for faces whose corners ascend when gone round, -1 for the others."""
    at = (faces == key[:, :1]).argmax(axis=1)
    after = faces[np.arange(len(faces)), (at + 1) % 3]
    return np.where(after == key[:, 1], 1, -1)


def weld_rims(points: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray, int, float]:
    """Merge vertices on open edges that are nearly in one place.

    Returns
    -------
    points, faces
    count : int
        Vertices merged away.
    gap : float
        The farthest any of them lay from its group's first.
    """
    sides = open_sides(faces)
    if len(sides) == 0:
        return points, faces, 0, 0.0
    rim = np.unique(sides)
    edge = np.linalg.norm(points[sides[:, 1]] - points[sides[:, 0]], axis=1)
    reach = min(
        LIMITS.gap * float(np.ptp(points, axis=0).max()),
        LIMITS.gap_per_edge * float(np.percentile(edge, 5)),
    )
    pairs = cKDTree(points[rim]).query_pairs(reach, output_type="ndarray")
    if len(pairs) == 0:
        return points, faces, 0, 0.0
    group = connected_parts(pairs, len(rim))
    groups = int(group.max()) + 1
    leader = np.full(groups, len(rim))
    np.minimum.at(leader, group, np.arange(len(rim)))
    number = np.arange(len(points))
    number[rim] = rim[leader[group]]
    gap = float(np.linalg.norm(points[rim] - points[number[rim]], axis=1).max())
    joined = points[number]
    new_points, new_faces = merged_surface(joined, faces)
    return new_points, new_faces, len(rim) - groups, gap
