"""Orient a mesh's faces consistently outwards."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.mesh import connected_parts, edges_of
from design.tissue.closed import FaceArray, enclosed_volume, face_areas, format_points
from design.tissue.parts import enclosures, neighbours, shells_of
from kernels.arrays import FloatArray


def agree(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Turn as little area as possible so that neighbours agree; how many faces were turned.

    Faces that agree form patches; of the patches joined across an edge one is turned.

    Raises
    ------
    TissueError
        When that can't be done (a Möbius strip).
    """
    one, two, alike = neighbours(edges_of(faces))
    if alike.all():
        return faces, 0
    patch = connected_parts(np.stack([one, two], axis=1)[alike], len(faces))
    count = int(patch.max()) + 1
    side = np.full(count, -1)
    against: dict[int, set[int]] = {}
    for a, b in np.unique(np.stack([patch[one[~alike]], patch[two[~alike]]], axis=1), axis=0):
        against.setdefault(int(a), set()).add(int(b))
        against.setdefault(int(b), set()).add(int(a))
    area = np.bincount(patch, weights=face_areas(points, faces), minlength=count)
    for first in range(count):
        if side[first] < 0:
            group = _two_sides(first, against, side)
            turned = group[side[group] == 1]
            if area[turned].sum() > 0.5 * area[group].sum():
                side[group] = 1 - side[group]
    wrong = side[patch[one]] != side[patch[two]]
    clash = wrong == alike
    if clash.any():
        where = points[faces[one[clash]]].mean(axis=1)
        raise TissueError(
            f"mesh can't be oriented: {int(clash.sum())} pairs of neighbouring faces contradict "
            f"one another ({format_points(where)}), as on a Möbius strip; mend the mesh there"
        )
    flip = side[patch] == 1
    agreeing = faces.copy()
    agreeing[flip] = agreeing[flip, ::-1]
    return agreeing, int(flip.sum())


def _two_sides(
    first: int, against: dict[int, set[int]], side: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Give patches joined to ``first`` alternating sides, in place; return them."""
    side[first] = 0
    queue, group = deque([first]), [first]
    while queue:
        here = queue.popleft()
        for other in sorted(against.get(here, ())):
            if side[other] < 0:
                side[other] = 1 - side[here]
                queue.append(other)
                group.append(other)
    return np.array(group)


def turn_shells(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Turn shells that lie in no other and look inward, with what they hold; how many.

    When all look the wrong way the mesh is merely inside out, which counts as nothing done.
    """
    if enclosed_volume(points, faces) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    shell = shells_of(points, faces)
    count = int(shell.max()) + 1
    if count == 1:
        return faces, 0
    holds = enclosures(points, faces, shell)
    turn = np.zeros(count, dtype=bool)
    for n in np.flatnonzero(~holds.any(axis=0)):
        if enclosed_volume(points, faces[shell == n]) < 0:
            turn[n] = True
            turn |= holds[n]
    turned = faces.copy()
    flip = turn[shell]
    turned[flip] = turned[flip, ::-1]
    return turned, int(turn.sum())
