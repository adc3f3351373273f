"""Exact signed distances to a triangle surface, and a grid of them.

Goes in: a triangle surface and points. Comes out: signed distances, mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.geometry import boxes_of, build_hierarchy
from design.solids.solid import Solid
from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray

UNKNOWN = np.empty(0, dtype=np.int64)
"""Guesses of `nearest` where there are none."""
CHUNK = 64
"""Points a thread takes at a time; each starts from the last one's triangle."""
FACE, EDGE_AB, EDGE_BC, EDGE_CA, CORNER_A, CORNER_B, CORNER_C = range(7)


@jit
def closest_on_triangle(
    px: float, py: float, pz: float, triangles: FloatArray, t: int
) -> tuple[float, float, float, int]:
    """Nearest point of a triangle of (m, 3, 3) and the feature it lies on.

    Voronoi regions after Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    # Numbers are taken one by one: a view of a row would cost more than what is computed of it.
    ax, ay, az = triangles[t, 0, 0], triangles[t, 0, 1], triangles[t, 0, 2]
    bx, by, bz = triangles[t, 1, 0] - ax, triangles[t, 1, 1] - ay, triangles[t, 1, 2] - az
    cx, cy, cz = triangles[t, 2, 0] - ax, triangles[t, 2, 1] - ay, triangles[t, 2, 2] - az
    qx, qy, qz = px - ax, py - ay, pz - az
    d1 = bx * qx + by * qy + bz * qz
    d2 = cx * qx + cy * qy + cz * qz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, CORNER_A
    ux, uy, uz = qx - bx, qy - by, qz - bz
    d3 = bx * ux + by * uy + bz * uz
    d4 = cx * ux + cy * uy + cz * uz
    if d3 >= 0.0 and d4 <= d3:
        return ax + bx, ay + by, az + bz, CORNER_B
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return ax + t * bx, ay + t * by, az + t * bz, EDGE_AB
    ux, uy, uz = qx - cx, qy - cy, qz - cz
    d5 = bx * ux + by * uy + bz * uz
    d6 = cx * ux + cy * uy + cz * uz
    if d6 >= 0.0 and d5 <= d6:
        return ax + cx, ay + cy, az + cz, CORNER_C
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return ax + t * cx, ay + t * cy, az + t * cz, EDGE_CA
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (
            ax + bx + t * (cx - bx),
            ay + by + t * (cy - by),
            az + bz + t * (cz - bz),
            EDGE_BC,
        )
    scale = 1.0 / (va + vb + vc)
    v, w = vb * scale, vc * scale
    return ax + v * bx + w * cx, ay + v * by + w * cy, az + v * bz + w * cz, FACE


@jit
def _box_distance2(boxes: FloatArray, node: int, px: float, py: float, pz: float) -> float:
    dx = max(boxes[node, 0] - px, 0.0, px - boxes[node, 3])
    dy = max(boxes[node, 1] - py, 0.0, py - boxes[node, 4])
    dz = max(boxes[node, 2] - pz, 0.0, pz - boxes[node, 5])
    return dx * dx + dy * dy + dz * dz


@jit
def _nearest_one(
    px: float,
    py: float,
    pz: float,
    triangles: FloatArray,
    boxes: FloatArray,
    nodes: IntArray,
    order: IntArray,
    stack: IntArray,
    away: FloatArray,
    guess: int,
) -> tuple[int, int, float, float, float, float]:
    """Nearest triangle, feature, foot and squared distance.

    A `guess` (the last point's triangle, or -1) bounds the search from its beginning. `stack` and
    `away` are room for nodes that are still to be looked at, and for their squared distances.
    """
    best, fx, fy, fz = np.inf, 0.0, 0.0, 0.0
    feature, triangle = 0, 0
    if guess >= 0:
        fx, fy, fz, feature = closest_on_triangle(px, py, pz, triangles, guess)
        best = (px - fx) ** 2 + (py - fy) ** 2 + (pz - fz) ** 2
        triangle = guess
    stack[0], away[0] = 0, 0.0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if away[top] >= best:
            continue
        left, right = nodes[node, 0], nodes[node, 1]
        if left < 0:
            for k in range(-1 - left, right):
                t = order[k]
                x, y, z, where = closest_on_triangle(px, py, pz, triangles, t)
                d2 = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
                if d2 < best:
                    best, feature, triangle = d2, where, t
                    fx, fy, fz = x, y, z
            continue
        to_left = _box_distance2(boxes, left, px, py, pz)
        to_right = _box_distance2(boxes, right, px, py, pz)
        if to_left < to_right:
            left, right, to_left, to_right = right, left, to_right, to_left
        # The nearer one goes on top; what is farther than the best isn't looked at again.
        if to_left < best:
            stack[top], away[top] = left, to_left
            top += 1
        if to_right < best:
            stack[top], away[top] = right, to_right
            top += 1
    return triangle, feature, fx, fy, fz, best


@pjit
def nearest(
    points: FloatArray,
    triangles: FloatArray,
    boxes: FloatArray,
    nodes: IntArray,
    order: IntArray,
    normals: FloatArray,
    guesses: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Signed distance, nearest point, direction of growing distance and triangle of each point.

    ``normals`` (m, 7, 3) holds the pseudonormal of each triangle's face, edges and corners
    (Bærentzen & Aanæs 2005, 10.1109/TVCG.2005.49), whose side is the true side even where the
    nearest point lies on an edge. Positive is outside. ``guesses`` (n,) are triangles near each
    point, or empty: the nearer the triangle, the less is searched.
    """
    n = len(points)
    distance = np.empty(n)
    foot = np.empty((n, 3))
    direction = np.empty((n, 3))
    face = np.empty(n, dtype=np.int64)
    for chunk in numba.prange((n + CHUNK - 1) // CHUNK):
        stack = np.empty(128, dtype=np.int64)
        away = np.empty(128)
        triangle = -1
        for i in range(chunk * CHUNK, min(n, (chunk + 1) * CHUNK)):
            px, py, pz = points[i, 0], points[i, 1], points[i, 2]
            if len(guesses) > 0:
                triangle = guesses[i]
            triangle, feature, fx, fy, fz, best = _nearest_one(
                px, py, pz, triangles, boxes, nodes, order, stack, away, triangle
            )
            ex, ey, ez = px - fx, py - fy, pz - fz
            nx, ny, nz = (
                normals[triangle, feature, 0],
                normals[triangle, feature, 1],
                normals[triangle, feature, 2],
            )
            side = 1.0 if ex * nx + ey * ny + ez * nz >= 0.0 else -1.0
            length = np.sqrt(best)
            distance[i], face[i] = side * length, triangle
            foot[i, 0], foot[i, 1], foot[i, 2] = fx, fy, fz
            if length > 1e-6:
                nx, ny, nz = side * ex / length, side * ey / length, side * ez / length
            direction[i, 0], direction[i, 1], direction[i, 2] = nx, ny, nz
    return distance, foot, direction, face


SHARP_RAD = 0.6
"""Edges that bend by more are edges, not facets of something round."""
RIM_STEP_MM = 0.05
"""Sharp edges are sampled so finely."""


@dataclass(frozen=True)
class Edges:
    """Where the triangles of a closed mesh meet.

    Attributes
    ----------
    one, other : (e,) int64
        The two triangles of each edge.
    tail, way : (e, 3) float64, mm
        An edge runs from `tail` to ``tail + way``.
    angle : (e,) float64, rad
        By which the surface bends there, above 0 where it bulges.
    """

    one: IntArray
    other: IntArray
    tail: FloatArray
    way: FloatArray
    angle: FloatArray

    @staticmethod
    def of(faces: IntArray, triangles: FloatArray) -> Edges:
        """Of ``faces`` (m, 3), vertices of a closed mesh, and their corners (m, 3, 3), mm."""
        tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        low, high = np.minimum(tail, head), np.maximum(tail, head)
        order = np.lexsort((high, low))
        low, high = low[order], high[order]
        pair = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
        first, second = order[pair], order[pair + 1] // 3
        start = triangles.reshape(-1, 3)[first]
        way = np.roll(triangles, -1, axis=1).reshape(-1, 3)[first] - start
        return Edges(first // 3, second, start, way, _bend(triangles, first // 3, second, way))

    @property
    def sharp(self) -> NDArray[np.bool_]:
        """Edges that are edges of the part, not seams between facets of something round."""
        return np.abs(self.angle) >= SHARP_RAD


def face_curvature(triangles: FloatArray, edges: Edges) -> FloatArray:
    """Sum of the principal curvatures of each triangle, (m,), 1/mm, above 0 where it bulges.

    An edge of length l that bends by θ carries θ l of it, half to either side (Cohen-Steiner &
    Morvan 2003, 10.1145/777792.777839); what slivers get of that is evened out over their
    neighbours. Sharp edges carry none, and nothing is evened out over them.
    """
    size = np.linalg.norm(_twice_area(triangles), axis=1)
    smooth = ~edges.sharp
    one, other = edges.one[smooth], edges.other[smooth]
    share = 0.5 * edges.angle[smooth] * np.linalg.norm(edges.way[smooth], axis=1)
    count = len(triangles)
    bent = np.asarray(np.bincount(one, share, count) + np.bincount(other, share, count), float)
    return np.asarray(_evened(bent, one, other) / _evened(0.5 * size, one, other))


def rim_samples(edges: Edges) -> FloatArray:
    """Points on the sharp edges, (r, 3), mm, no further apart than `RIM_STEP_MM`."""
    tail, way = edges.tail[edges.sharp], edges.way[edges.sharp]
    steps = np.ceil(np.linalg.norm(way, axis=1) / RIM_STEP_MM).astype(np.int64)
    first = np.cumsum(steps) - steps
    which = np.repeat(np.arange(len(way)), steps)
    share = (np.arange(len(which)) - first[which] + 0.5) / steps[which]
    return np.asarray(tail[which] + share[:, None] * way[which])


def _twice_area(triangles: FloatArray) -> FloatArray:
    """Normals as long as twice the area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _bend(triangles: FloatArray, one: IntArray, other: IntArray, way: FloatArray) -> FloatArray:
    """Angle of each edge, above 0 where the surface bulges."""
    normal = _twice_area(triangles)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    sine = (np.cross(normal[one], normal[other]) * way).sum(axis=1)
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-30)
    return np.arctan2(sine / length, (normal[one] * normal[other]).sum(axis=1))


def _evened(values: FloatArray, one: IntArray, other: IntArray) -> FloatArray:
    """Each triangle's value and those of its neighbours."""
    count = len(values)
    return np.asarray(
        values + np.bincount(one, values[other], count) + np.bincount(other, values[one], count)
    )


# Triangles that are long against the whole (flat faces, straight tubes) make boxes that overlap.
# They are cut into pieces with boxes of their own (Ernst & Greiner 2007, 10.1109/RT.2007.4342593);
# what is asked at a piece is still its whole triangle. Points near a block with lumens take two
# thirds of the time.
LONGEST = 0.15
"""Of the diagonal: longer edges are cut. Finer pieces only make more boxes."""


def hierarchy(triangles: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Build the tree of (m, 3, 3) triangles.

    Returns
    -------
    boxes, nodes : arrays
        See `design.geometry.bvh.build_hierarchy`.
    order : (k,) int64
        Triangles in the order of the leaves; those that were cut several times.
    """
    pieces, owner = _pieces(triangles)
    boxes, nodes, order = build_hierarchy(boxes_of(pieces))
    return boxes, nodes, owner[order]


def _pieces(triangles: FloatArray) -> tuple[FloatArray, IntArray]:
    """Cut triangles in the middle of their longest edge while it is long: (k, 3, 3), and whose."""
    corners = triangles.reshape(-1, 3)
    longest = LONGEST * float(np.linalg.norm(np.ptp(corners, axis=0)))
    whole, owner = triangles, np.arange(len(triangles))
    while True:
        edges = np.linalg.norm(np.roll(whole, -1, axis=1) - whole, axis=2)
        cut = np.flatnonzero(edges.max(axis=1) > longest)
        if not len(cut):
            return np.ascontiguousarray(whole), owner
        first = edges[cut].argmax(axis=1)
        a, b, c = (whole[cut, (first + k) % 3] for k in range(3))
        middle = (a + b) / 2
        halves = [np.stack(half, axis=1) for half in ((a, middle, c), (middle, b, c))]
        whole = np.concatenate([np.delete(whole, cut, axis=0), *halves])
        owner = np.concatenate([np.delete(owner, cut), owner[cut], owner[cut]])


@dataclass(frozen=True)
class Nearest:
    """Answers for n points.

    Attributes
    ----------
    distance : (n,) float64, mm
        Positive outside the solid.
    foot : (n, 3) float64, mm
        Nearest point of the surface.
    direction : (n, 3) float64
        Unit gradient of the distance.
    face : (n,) int64
        Triangle of the foot.
    """

    distance: FloatArray
    foot: FloatArray
    direction: FloatArray
    face: IntArray


@dataclass(frozen=True)
class ModelSurface:
    """Triangles, their hierarchy and pseudonormals; build with `of`.

    Attributes
    ----------
    triangles : (m, 3, 3) float64, mm
        Corners.
    normals : (m, 7, 3) float64
        Pseudonormals of face, edges ab, bc, ca, corners a, b, c.
    curvature : (m,) float64, 1/mm
        Sum of the principal curvatures, see `registration.alignment.distance`.
    rims : (r, 3) float64, mm
        Points on its sharp edges.
    boxes, nodes, order : arrays
        See `registration.alignment.distance.hierarchy`.
    """

    triangles: FloatArray
    normals: FloatArray
    curvature: FloatArray
    rims: FloatArray
    boxes: FloatArray
    nodes: IntArray
    order: IntArray

    @staticmethod
    def of(solid: Solid) -> ModelSurface:
        """Prepare the surface of `solid`; triangles without area are left out."""
        corners = solid.vertices[solid.faces]
        twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        kept = np.linalg.norm(twice, axis=1) > 1e-14
        triangles = np.ascontiguousarray(corners[kept])
        faces = solid.faces[kept].astype(np.int64)
        normals = _pseudonormals(faces, triangles, len(solid.vertices))
        edges = Edges.of(faces, triangles)
        curvature, rims = face_curvature(triangles, edges), rim_samples(edges)
        return ModelSurface(triangles, normals, curvature, rims, *hierarchy(triangles))

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner, (2, 3), mm."""
        return self.boxes[0].reshape(2, 3)

    @property
    def centroid(self) -> FloatArray:
        """Centroid of the surface by area, (3,), mm."""
        a, b, c = (self.triangles[:, k] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.asarray(np.average((a + b + c) / 3, axis=0, weights=area))

    def blurred(self, face: IntArray, blur_mm: float) -> FloatArray:
        """How far a blur of the volume moves its half level at these triangles, (n,), mm.

        A surface of curvature κ moves by -σ²κ/2: a blurred lumen is narrower, a blurred knob
        smaller. First order in σκ (the level sets of a diffused step move by their curvature:
        Osher & Sethian 1988, 10.1016/0021-9991(88)90002-2).
        """
        return np.asarray(-0.5 * blur_mm**2 * self.curvature[face])

    def near_rims(self, points: FloatArray, reach_mm: float) -> NDArray[np.bool_]:
        """Which of (n, 3) points lie within `reach_mm` of a sharp edge."""
        if not len(self.rims):
            return np.zeros(len(points), dtype=np.bool_)
        away, _ = cKDTree(self.rims).query(points, distance_upper_bound=reach_mm)
        return np.asarray(np.isfinite(away))

    def query(self, points: FloatArray, guesses: IntArray = UNKNOWN) -> Nearest:
        """Nearest surface points and signed distances of (n, 3) points, exact.

        `guesses` (n,): triangles that were nearest to the points before they moved a little.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        return Nearest(
            *nearest(
                points, self.triangles, self.boxes, self.nodes, self.order, self.normals, guesses
            )
        )


def _pseudonormals(faces: IntArray, triangles: FloatArray, vertices: int) -> FloatArray:
    """Face normals; edge normals summed over both faces; corner normals weighted by angle."""
    a, b, c = (triangles[:, k] for k in range(3))
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    corner = np.zeros((vertices, 3))
    for k in range(3):
        here, ahead, back = (triangles[:, (k + j) % 3] for j in (0, 1, 2))
        u, v = ahead - here, back - here
        cosine = np.einsum("ij,ij->i", u, v)
        cosine /= np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(corner, faces[:, k], angle[:, None] * face)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    key, which = np.unique(ends[:, 0] * vertices + ends[:, 1], return_inverse=True)
    edge = np.zeros((len(key), 3))
    np.add.at(edge, which, np.repeat(face, 3, axis=0))
    edges = edge[which].reshape(-1, 3, 3)
    out = np.concatenate([face[:, None], edges, corner[faces]], axis=1)
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-30))


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distances at grid points.

    Attributes
    ----------
    values : (nz, ny, nx) float32, mm
        Positive outside.
    origin_mm : (3,) float64, mm
        Position of value (0, 0, 0), as x, y, z.
    step_mm : float, mm
        Between grid points.
    """

    values: NDArray[np.float32]
    origin_mm: FloatArray
    step_mm: float


def distance_grid(
    surface: ModelSurface, margin_mm: float, finest_mm: float, most: int = 300_000
) -> DistanceGrid:
    """Exact distances on a grid over the surface's box and a margin.

    The step is `finest_mm`, or as coarse as `most` grid points demand.
    """
    low, high = surface.bounds[0] - margin_mm, surface.bounds[1] + margin_mm
    step = max(finest_mm, float((np.prod(high - low) / most) ** (1 / 3)))
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    values = surface.query(points).distance.astype(np.float32).reshape(x.shape)
    return DistanceGrid(values, low, step)
