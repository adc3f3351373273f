"""Exact meshes of pipes: quadratic tetrahedra, straight or along an arc."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.hemodynamics.three_d.lumen_mesh import EDGES, LumenMesh, MeshPort


def pipe_mesh(
    radius_mm: float, length_mm: float, rings: int, layers: int, bend_rad: float = 0.0
) -> LumenMesh:
    """A pipe from the origin along z; port 0, the inlet, at its beginning, port 1 at its end.

    With ``bend_rad`` its axis is an arc of that angle and length in the plane of x and z.
    """
    disc, triangles = _disc(rings)
    count = len(disc)
    z = np.linspace(0.0, 1.0, layers + 1)
    corners = np.concatenate([np.column_stack([disc, np.full(count, at)]) for at in z])
    tets = _prisms_cut(triangles, count, layers)
    flat = _volume(corners[tets]) < 0.0
    tets[flat] = tets[flat][:, [0, 2, 1, 3]]
    ends = np.sort(tets[:, EDGES], axis=2).reshape(-1, 2)
    pairs, which = np.unique(ends, axis=0, return_inverse=True)
    middle = corners[pairs].mean(1)
    rim = np.hypot(corners[:, 0], corners[:, 1]) > 1.0 - 1e-9
    curved = rim[pairs].all(1) & (np.abs(np.hypot(middle[:, 0], middle[:, 1]) - 1.0) < 0.4)
    middle[curved, :2] /= np.hypot(*middle[curved, :2].T)[:, None]
    points = np.concatenate([corners, middle])
    cells = np.column_stack([tets, len(corners) + which.reshape(-1, 6)])
    faces, label = _boundary(points, cells)
    across, down = points[:, :2] * radius_mm, points[:, 2]
    swept, ports = _swept(across, down, length_mm, bend_rad, radius_mm)
    return LumenMesh(swept, cells, len(corners), faces, label, ports)


def _disc(rings: int) -> tuple[Any, Any]:
    """A unit disc: 6k points on ring k, triangles between rings."""
    points, start = [np.zeros((1, 2))], [0]
    for k in range(1, rings + 1):
        angle = 2.0 * np.pi * np.arange(6 * k) / (6 * k)
        start.append(start[-1] + max(6 * (k - 1), 1))
        points.append(k / rings * np.column_stack([np.cos(angle), np.sin(angle)]))
    found = []
    for k in range(1, rings + 1):
        for sector in range(6):
            for j in range(k):
                outer = [start[k] + (sector * k + j + i) % (6 * k) for i in (0, 1)]
                turn = max(6 * (k - 1), 1)
                inner = [start[k - 1] + (sector * (k - 1) + j + i) % turn for i in (0, 1)]
                found.append([inner[0], *outer])
                if j < k - 1:
                    found.append([inner[0], outer[1], inner[1]])
    return np.concatenate(points), np.array(found)


def _prisms_cut(triangles: Any, count: int, layers: int) -> Any:
    """Three tetrahedra a prism, cut the same way on both sides of every quadrilateral."""
    a, b, c = np.sort(triangles, axis=1).T
    up = count
    cut = [(a, b, c, c + up), (a, b, b + up, c + up), (a, a + up, b + up, c + up)]
    layer = np.concatenate([np.column_stack(tet) for tet in cut])
    return np.concatenate([layer + k * count for k in range(layers)])


def _volume(p: Any) -> Any:
    return np.einsum("ti,ti->t", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 3] - p[:, 0])


def _boundary(points: Any, cells: Any) -> tuple[Any, Any]:
    """Outward faces with the nodes on their edges, and labels: 0 wall, 1 and 2 the ends."""
    # Corners outward for a positive tetrahedron; its edges' places follow EDGES.
    sides = [[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6]]
    faces = cells[:, sides].reshape(-1, 6)
    _, first, times = np.unique(
        np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = faces[np.sort(first[times == 1])]
    height = points[outer[:, :3], 2]
    label = np.where((height < 1e-9).all(1), 1, np.where((height > 1.0 - 1e-9).all(1), 2, 0))
    return outer, label


def _swept(
    across: Any, down: Any, length: float, bend: float, radius: float
) -> tuple[Any, tuple[MeshPort, ...]]:
    if bend == 0.0:
        points = np.column_stack([across, down * length])
        axis, end = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, length])
    else:
        arc, angle = length / bend, down * bend
        out = arc - across[:, 0]
        points = np.column_stack([arc - out * np.cos(angle), across[:, 1], out * np.sin(angle)])
        axis = np.array([np.sin(bend), 0.0, np.cos(bend)])
        end = np.array([arc * (1.0 - np.cos(bend)), 0.0, arc * np.sin(bend)])
    start = MeshPort(0, np.zeros(3), np.array([0.0, 0.0, -1.0]), radius, True)
    return points, (start, MeshPort(1, end, axis, radius, False))
