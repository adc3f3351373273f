"""Meshes of pipes for tests: rings of triangles swept along a line, and a bend of it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from design.hemodynamics.three_d.meshing.lumen_mesh import EDGES, LumenMesh, MeshPort
from kernels.arrays import FloatArray, IntArray

Map = Callable[[FloatArray], FloatArray]


def disc(rings: int) -> tuple[FloatArray, IntArray]:
    """Points and triangles of the unit disc, 6 k points on ring k."""
    place = {(0, 0): 0}
    points = [(0.0, 0.0)]
    for k in range(1, rings + 1):
        for j in range(6 * k):
            place[k, j] = len(points)
            angle = np.pi * j / (3 * k)
            points.append((k / rings * np.cos(angle), k / rings * np.sin(angle)))

    def at(k: int, j: int) -> int:
        return place[k, j % (6 * k)] if k else 0

    triangles = []
    for k in range(1, rings + 1):
        for sector in range(6):
            for j in range(k):
                outer, inner = sector * k + j, sector * (k - 1) + j
                triangles.append((at(k - 1, inner), at(k, outer), at(k, outer + 1)))
                if j < k - 1:
                    triangles.append((at(k - 1, inner), at(k, outer + 1), at(k - 1, inner + 1)))
    return np.array(points), np.array(triangles)


def swept(rings: int, layers: int, shape: Map, ports: tuple[MeshPort, MeshPort]) -> LumenMesh:
    """A cylinder of radius and length 1, quadratic nodes and all, through ``shape``."""
    flat, triangles = disc(rings)
    count = len(flat)
    corners = np.concatenate(
        [np.column_stack([flat, np.full(count, k / layers)]) for k in range(layers + 1)]
    )
    tets = []
    for k in range(layers):
        for triangle in np.sort(triangles, axis=1):
            a, b, c = triangle + k * count
            d, e, f = triangle + (k + 1) * count
            tets += [(a, b, c, f), (a, b, f, e), (a, e, f, d)]
    tet = np.array(tets)
    first, second, third = (corners[tet[:, i]] - corners[tet[:, 0]] for i in (1, 2, 3))
    wrong = np.einsum("ij,ij->i", np.cross(first, second), third) < 0.0
    tet[wrong] = tet[wrong][:, [1, 0, 2, 3]]
    pair, where = np.unique(
        np.sort(tet[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    middle = corners[pair].mean(axis=1)
    polar = np.hypot(*corners[:, :2].T)
    outside = (polar[pair] > 1.0 - 1e-9).all(axis=1)
    middle[outside, :2] /= np.hypot(*middle[outside, :2].T)[:, None]
    points = np.concatenate([corners, middle])
    whole = np.concatenate([tet, len(corners) + where.reshape(-1, 6)], axis=1)
    faces, label = _faces(points, whole)
    return LumenMesh(shape(points), whole, len(corners), faces, label, ports)


def _faces(points: FloatArray, tets: IntArray) -> tuple[IntArray, IntArray]:
    sides = np.array(
        [[0, 2, 1, 6, 5, 4], [0, 1, 3, 4, 8, 7], [0, 3, 2, 7, 9, 6], [1, 2, 3, 5, 9, 8]]
    )
    faces = tets[:, sides].reshape(-1, 6)
    _, first, count = np.unique(
        np.sort(faces[:, :3], axis=1), axis=0, return_index=True, return_counts=True
    )
    faces = faces[first[count == 1]]
    height = points[faces[:, :3], 2]
    label = np.where(
        (height < 1e-9).all(axis=1), 1, np.where((height > 1 - 1e-9).all(axis=1), 2, 0)
    )
    return faces, label


def pipe(
    rings: int = 2, layers: int = 6, radius: float = 0.5, length: float = 4.0, taper: float = 1.0
) -> LumenMesh:
    """A straight pipe along z from node 0 to node 1, its far radius ``taper`` of the near one."""

    def shape(unit: FloatArray) -> FloatArray:
        wide = radius * (1.0 + (taper - 1.0) * unit[:, 2:])
        return np.column_stack([wide * unit[:, :2], length * unit[:, 2]])

    ends = (
        MeshPort(0, np.zeros(3), np.array([0.0, 0.0, -1.0]), radius, True),
        MeshPort(1, np.array([0.0, 0.0, length]), np.array([0.0, 0.0, 1.0]), radius * taper, False),
    )
    return swept(rings, layers, shape, ends)


def bend(
    rings: int = 2,
    layers: int = 8,
    radius: float = 0.5,
    turn: float = 1.5,
    angle: float = np.pi / 2,
) -> LumenMesh:
    """A bent pipe in the plane of x and z, of curvature 1/turn on its axis."""

    def shape(unit: FloatArray) -> FloatArray:
        x, y, phi = radius * unit[:, 0], radius * unit[:, 1], angle * unit[:, 2]
        return np.column_stack([turn - (turn - x) * np.cos(phi), y, (turn - x) * np.sin(phi)])

    end = np.array([turn - turn * np.cos(angle), 0.0, turn * np.sin(angle)])
    ends = (
        MeshPort(0, np.zeros(3), np.array([0.0, 0.0, -1.0]), radius, True),
        MeshPort(1, end, np.array([np.sin(angle), 0.0, np.cos(angle)]), radius, False),
    )
    return swept(rings, layers, shape, ends)


def beside(first: LumenMesh, second: LumenMesh, offset: FloatArray) -> LumenMesh:
    """Two lumens in one mesh, the second moved; its ports' nodes follow the first's."""
    corners, edges = (
        np.concatenate(parts)
        for parts in zip(
            np.split(first.points, [first.corner_count]),
            np.split(second.points + offset, [second.corner_count]),
            strict=True,
        )
    )
    more = len(first.points) - first.corner_count

    def of_first(node: IntArray) -> IntArray:
        return np.where(node < first.corner_count, node, node + second.corner_count)

    def of_second(node: IntArray) -> IntArray:
        corner = node < second.corner_count
        return np.where(corner, node + first.corner_count, node + first.corner_count + more)

    moved = tuple(
        replace(port, node=port.node + len(first.ports), centre=port.centre + offset)
        for port in second.ports
    )
    return LumenMesh(
        np.concatenate([corners, edges]),
        np.concatenate([of_first(first.tets), of_second(second.tets)]),
        first.corner_count + second.corner_count,
        np.concatenate([of_first(first.faces), of_second(second.faces)]),
        np.concatenate([first.label, np.where(second.label > 0, second.label + 2, 0)]),
        first.ports + moved,
    )
