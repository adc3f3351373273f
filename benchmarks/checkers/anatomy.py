"""Measure anatomy independently: kinks, depth of trunks, Strahler orders, veins beside arteries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.networks import FloatArray, IntArray, Pieces


def main_line_turns(net: Pieces) -> tuple[FloatArray, FloatArray]:
    """Turn (degrees) from each piece to the widest that leaves its end, and its radius, mm.

    Bends of a vessel and ways through joints count alike.
    """
    way = net.end - net.start
    way = way / np.linalg.norm(way, axis=1)[:, None]
    radius = net.radius.mean(axis=1)
    widest: dict[int, int] = {}
    for piece in np.argsort(radius, kind="stable").tolist():
        widest[int(net.node[piece, 0])] = piece
    turns, wide = [], []
    for piece in range(net.count):
        after = widest.get(int(net.node[piece, 1]))
        if after is not None:
            cosine = float(np.clip(way[piece] @ way[after], -1.0, 1.0))
            turns.append(np.degrees(np.arccos(cosine)))
            wide.append(radius[piece])
    return np.array(turns), np.array(wide)


def kinks(net: Pieces, degrees: float, of_root: float) -> int:
    """Turns above an angle in pieces wider than a part of their tree's widest."""
    count = 0
    for tree in np.unique(net.tree):
        mine = net.tree == tree
        part = Pieces(*(getattr(net, name)[mine] for name in Pieces.__dataclass_fields__))
        turn, wide = main_line_turns(part)
        count += int(((turn > degrees) & (wide > of_root * part.radius.max())).sum())
    return count


def wide_pieces(net: Pieces, of_root: float) -> NDArray[np.bool_]:
    """Pieces (n,) wider than a part of their tree's widest: trunks, by nobody's list."""
    radius = net.radius.mean(axis=1)
    widest = {tree: radius[net.tree == tree].max() for tree in np.unique(net.tree).tolist()}
    return np.asarray(radius > of_root * np.array([widest[tree] for tree in net.tree.tolist()]))


def triangle_distance(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Distance (n,) of points from the nearest of triangles (m, 3, 3), by the nearest corners.

    Of each point the triangles about its 40 nearest centres are tried: by plane, edge and corner.
    """
    from scipy.spatial import cKDTree

    near = cKDTree(triangles.mean(axis=1)).query(points, min(40, len(triangles)))[1]
    best = np.full(len(points), np.inf)
    for k in range(near.shape[1]):
        best = np.minimum(best, _one_each(points, triangles[near[:, k]]))
    return best


def _one_each(points: FloatArray, triangle: FloatArray) -> FloatArray:
    a, b, c = triangle[:, 0], triangle[:, 1], triangle[:, 2]
    normal = np.cross(b - a, c - a)
    size = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(size > 0, size, 1.0)
    to = points - a
    u = np.einsum("ij,ij->i", np.cross(b - a, to), normal) / safe
    v = np.einsum("ij,ij->i", np.cross(to, c - a), normal) / safe
    inner = (u >= 0) & (v >= 0) & (u + v <= 1) & (size > 0)
    plane = np.abs(np.einsum("ij,ij->i", to, normal)) / np.sqrt(safe)
    edges = np.minimum.reduce([_edge(points, *ends) for ends in ((a, b), (b, c), (c, a))])
    found: FloatArray = np.where(inner, plane, edges)
    return found


def _edge(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    along = b - a
    square = np.maximum(np.einsum("ij,ij->i", along, along), 1e-30)
    t = np.clip(np.einsum("ij,ij->i", points - a, along) / square, 0.0, 1.0)
    found: FloatArray = np.linalg.norm(points - a - t[:, None] * along, axis=1)
    return found


def outer_triangles(triangles: FloatArray, rays: int = 24) -> FloatArray:
    """Those triangles (k, 3, 3) from whose centre most directions outward leave the mesh.

    Marched through voxels of 1/96 of the mesh's extent: coarse, and another way than the
    product's. Faces that look to where few faces do (a base) are kept.
    """
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    cell = float((high - low).max()) / 96
    shape = np.ceil((high - low) / cell).astype(int) + 3
    wall = np.zeros(shape, dtype=bool)
    for u, v in ((0.33, 0.33), (0.6, 0.2), (0.2, 0.6), (0.1, 0.1), (0.8, 0.1), (0.1, 0.8)):
        at = (1 - u - v) * triangles[:, 0] + u * triangles[:, 1] + v * triangles[:, 2]
        wall[tuple(((at - low) / cell + 1).astype(int).T)] = True
    centre = triangles.mean(axis=1)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-30)[:, None]
    random = np.random.default_rng(5).normal(size=(rays, 3))
    leaves = np.zeros(len(triangles))
    for ray in random / np.linalg.norm(random, axis=1)[:, None]:
        way = np.where((normal @ ray > 0)[:, None], ray, -ray)
        going = np.ones(len(triangles), dtype=bool)
        for step in range(3, 170):
            at = ((centre + step * cell * way - low) / cell + 1).astype(int)
            within = ((at >= 0) & (at < shape)).all(axis=1)
            hit = np.zeros(len(at), dtype=bool)
            hit[within] = wall[tuple(at[within].T)]
            going &= ~hit
            if not (going & within).any():
                break
        leaves += going
    kept: FloatArray = triangles[leaves > 0.5 * rays]
    return kept


def one_kind(net: Pieces, kind: str) -> Pieces:
    """The pieces of one kind; of veins turned round, so that all run from the root."""
    return _part(net, net.kind == kind, kind)


def _part(net: Pieces, mine: NDArray[np.bool_], kind: str) -> Pieces:
    found = Pieces(*(getattr(net, name)[mine] for name in Pieces.__dataclass_fields__))
    if kind == "vein":
        found = replace(
            found,
            node=found.node[:, ::-1],
            start=found.end,
            end=found.start,
            radius=found.radius[:, ::-1],
        )
    _, node = np.unique(found.node, return_inverse=True)
    return replace(found, node=node.reshape(-1, 2).astype(np.int64))


def above_terminals(net: Pieces) -> NDArray[np.bool_]:
    """Which pieces belong to vessels that branch: all but those that end in a terminal."""
    last = net.vessel[~np.isin(net.node[:, 1], net.node[:, 0])]
    return ~np.isin(net.vessel, last)


def length_beside(
    net: Pieces, other: Pieces, diameters: float, step_mm: float = 0.2
) -> tuple[FloatArray, FloatArray]:
    """Length of each piece (n,), mm, and how much of it has the other's axis near enough.

    Near enough: axis within so many of the piece's own diameters of a piece's axis. Pieces are
    sampled every ``step_mm`` or finer; to each sample the nearest of the other's axis points
    (every 0.05 mm) counts, so that distances come out too large rather than too small.
    """
    from scipy.spatial import cKDTree

    targets, _, _ = _sampled(other, 0.05)
    points, piece, share = _sampled(net, step_mm)
    away = cKDTree(targets).query(points)[0]
    near = away <= diameters * 2.0 * net.radius.mean(axis=1)[piece]
    weight: FloatArray = net.length[piece] * share * near
    beside = np.bincount(piece, weight, net.count).astype(np.float64)
    return net.length, beside


def _sampled(net: Pieces, step_mm: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Points along all pieces, each point's piece and the share of the piece that it stands for."""
    parts = np.maximum(1, np.ceil(net.length / step_mm)).astype(np.int64)
    piece = np.repeat(np.arange(net.count), parts)
    first = np.repeat(np.cumsum(parts) - parts, parts)
    along = (np.arange(len(piece)) - first + 0.5) / parts[piece]
    points = net.start[piece] + along[:, None] * (net.end - net.start)[piece]
    return points, piece, 1.0 / parts[piece]
