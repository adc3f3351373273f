"""Split faces at vertices that lie on their open edges (T-junctions)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.geometry.mesh import edges_of
from design.tissue.closed import FaceArray
from design.tissue.mesh_repair.limits import LIMITS
from kernels.arrays import FloatArray


def split_joints(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Give faces the vertices of their open edges that neighbours have there.

    A program that splits an edge of one face only leaves a slit without width: the edges are open,
    and nothing is missing.

    Returns
    -------
    faces : (m, 3) int32
    count : int
        Edges split.
    """
    done = 0
    near = LIMITS.rounding * float(np.ptp(points, axis=0).max())
    for _ in range(LIMITS.joint_rounds):
        faces, count = _split_once(points, faces, near)
        done += count
        if count == 0:
            break
    return faces, done


def _split_once(points: FloatArray, faces: FaceArray, near: float) -> tuple[FaceArray, int]:
    """Split one edge of each face that has one to be split."""
    edges = edges_of(faces)
    side = np.flatnonzero(edges.uses[edges.of_face] == 1)
    if len(side) == 0:
        return faces, 0
    rim = np.unique(edges.ends[edges.uses == 1])
    tree = cKDTree(points[rim])
    taken: set[int] = set()
    new: list[tuple[int, int, int]] = []
    for face, k in zip((side // 3).tolist(), (side % 3).tolist(), strict=True):
        a, b, c = (int(faces[face, (k + n) % 3]) for n in range(3))
        on = [] if face in taken else _between(points, rim, tree, (a, b, c), near)
        if on:
            taken.add(face)
            new += [(p, q, c) for p, q in zip([a, *on], [*on, b], strict=True)]
    if not taken:
        return faces, 0
    rest = np.delete(faces, sorted(taken), axis=0)
    return np.concatenate([rest, np.array(new, dtype=np.int32)]), len(taken)


def _between(
    points: FloatArray,
    rim: NDArray[np.int64],
    tree: cKDTree,
    corners: tuple[int, int, int],
    near: float,
) -> list[int]:
    """Rim vertices on edge ab of a face, in order from a."""
    a, b, _ = corners
    way = points[b] - points[a]
    length = float(np.linalg.norm(way))
    some = rim[tree.query_ball_point(points[a] + 0.5 * way, 0.5 * length + near)]
    some = some[~np.isin(some, corners)]
    along = (points[some] - points[a]) @ way / length
    beside = np.linalg.norm(points[some] - points[a] - np.outer(along / length, way), axis=1)
    on = (beside <= near) & (along > near) & (along < length - near)
    return [int(v) for v in some[on][np.argsort(along[on])]]
