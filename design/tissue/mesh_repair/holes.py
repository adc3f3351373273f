"""Fill the small holes of a triangle surface, each with the patch of least area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.mesh import edges_of
from design.tissue.closed import FaceArray, face_areas, format_points
from design.tissue.mesh_repair.limits import LIMITS
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Hole:
    """A rim that was filled: its middle, and its largest extent."""

    centre: FloatArray
    width: float


def fill_holes(points: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray, list[Hole]]:
    """Close each rim of open edges with the patch of least area (Barequet & Sharir 1995).

    Raises
    ------
    TissueError
        When a hole or all of them are too large (`LIMITS`), or the open edges don't form rims.
    """
    rims = _rims(points, faces)
    if not rims:
        return points, faces, []
    extent = float(np.ptp(points, axis=0).max())
    holes = [
        Hole(points[rim].mean(axis=0), float(np.ptp(points[rim], axis=0).max())) for rim in rims
    ]
    wide = [hole for hole in holes if hole.width > LIMITS.hole_width * extent]
    if wide:
        raise TissueError(
            f"mesh is open: {len(wide)} of {len(holes)} holes are too wide to be filled without "
            f"guessing, the widest {max(h.width for h in wide):.3g} of "
            f"{LIMITS.hole_width * extent:.3g} allowed "
            f"({format_points(np.array([h.centre for h in wide]))}); "
            f"{sum(len(rim) for rim in rims)} of {len(edges_of(faces).uses)} edges aren't shared "
            "by two faces; close them in a mesh editor and try again"
        )
    area = float(face_areas(points, faces).sum())
    new: list[NDArray[np.int64]] = []
    for rim in rims:
        points, patch = _patch(points, rim)
        new.append(patch)
    patches = np.concatenate(new)
    filled = float(face_areas(points, patches).sum())
    if filled > LIMITS.hole_area * area:
        raise TissueError(
            f"mesh is open: {len(holes)} holes make up {100 * filled / area:.2g} % of its surface, "
            f"above {100 * LIMITS.hole_area:g} % "
            f"({format_points(np.array([h.centre for h in holes]))}); close them in a mesh editor "
            "and try again"
        )
    return points, np.concatenate([faces, patches.astype(np.int32)]), holes


def open_sides(faces: FaceArray) -> FaceArray:
    """The sides of faces without a neighbour, as their two vertices in order, (k, 2)."""
    edges = edges_of(faces)
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return sides[edges.uses[edges.of_face] == 1]


def _rims(points: FloatArray, faces: FaceArray) -> list[NDArray[np.int64]]:
    """Loops of open edges, each the way round in which its patch is to be wound."""
    sides = open_sides(faces)
    onward: dict[int, list[int]] = {}
    for b, a in sides.tolist():
        onward.setdefault(a, []).append(b)
    rims: list[NDArray[np.int64]] = []
    while onward:
        path = [next(iter(onward))]
        while True:
            ways_on = onward.get(path[-1])
            if not ways_on:
                raise TissueError(
                    f"mesh is open, and its {len(sides)} open edges form no closed rims "
                    f"({format_points(points[[path[-1]]])}); mend it there and try again"
                )
            following = ways_on.pop()
            if not ways_on:
                del onward[path[-1]]
            if following in path:
                # Rims that touch in a vertex are taken apart there.
                at = path.index(following)
                rims.append(np.array(path[at:]))
                path = path[: at + 1]
                if len(path) == 1:
                    break
            else:
                path.append(following)
    return rims


def _patch(points: FloatArray, rim: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Triangles that fill a rim; a long one gets a new vertex in its middle."""
    if len(rim) < 3:
        return points, np.empty((0, 3), dtype=np.int64)
    if len(rim) <= LIMITS.exact_rim:
        return points, rim[_least_patch(points[rim])]
    middle = np.full(len(rim), len(points))
    fan = np.stack([rim, np.roll(rim, -1), middle], axis=1)
    return np.concatenate([points, points[rim].mean(axis=0, keepdims=True)]), fan


def _least_patch(rim: FloatArray) -> NDArray[np.int64]:
    """Triangulation of a closed polygon (n, 3) of least area, by dynamic programming."""
    n = len(rim)
    cost = np.zeros((n, n))
    choice = np.zeros((n, n), dtype=np.int64)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            m = np.arange(i + 1, j)
            across = np.cross(rim[m] - rim[i], rim[j] - rim[i])
            total = cost[i, m] + cost[m, j] + np.linalg.norm(across, axis=1)
            best = int(np.argmin(total))
            cost[i, j], choice[i, j] = total[best], m[best]
    triangles: list[tuple[int, int, int]] = []
    todo = [(0, n - 1)]
    while todo:
        i, j = todo.pop()
        if j - i < 2:
            continue
        middle = int(choice[i, j])
        triangles.append((i, middle, j))
        todo += [(i, middle), (middle, j)]
    return np.array(triangles, dtype=np.int64)
