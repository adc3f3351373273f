"""Build a tissue's signed distance grid from a closed mesh."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from design.geometry import TriangleTree, build_triangle_tree, gather_within, nearest_distance
from design.geometry.segments import SLIVER
from design.tissue.grid import BAND_CELLS, BRICK, GridArrays, SignedDistanceGrid, mix, read
from design.tissue.grid_lines import Columns, cross_columns
from kernels import jit, pjit
from kernels.arrays import FloatArray

_HALF_DIAGONAL = 0.5 * BRICK * sqrt(3.0)


def build_grid(
    vertices: FloatArray, faces: NDArray[np.int32], spacing_mm: float
) -> tuple[SignedDistanceGrid, Columns]:
    """Build the grid with exact samples; the winding number gives the sign.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int32
        Closed, outward-oriented.
    spacing_mm : float
        Between fine samples.

    Returns
    -------
    SignedDistanceGrid, Columns
        The grid, and the surface crossings along x on its lines.

    Raises
    ------
    TissueError
        When the mesh isn't closed and consistently oriented.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = BRICK * spacing_mm
    counts = np.ceil((high - low) / cell + 0.5).astype(np.int64)
    origin = 0.5 * (low + high) - 0.5 * cell * counts
    tree = build_triangle_tree(vertices, faces)
    fine = BRICK * counts + 1
    columns = cross_columns(vertices[faces], 0, origin, spacing_mm, (int(fine[1]), int(fine[2])))
    coarse = _coarse(tree, columns, origin, spacing_mm, counts + 1)
    brick = _choose_bricks(tree, origin, spacing_mm, counts)
    places = np.argwhere(brick >= 0)
    brick[tuple(places.T)] = np.arange(len(places), dtype=np.int32)
    samples = fill_bricks(tree, columns, origin, spacing_mm, places)
    coarse = _lowered(tree, coarse, brick, origin, spacing_mm)
    arrays = GridArrays(origin, float(spacing_mm), coarse, brick, samples, *tree)
    error, deepest = _measure(tree, arrays, places)
    return SignedDistanceGrid(arrays, float(error), float(max(deepest, -coarse.min()))), columns


@pjit
def _coarse(tree: Any, columns: Any, origin: Any, h: float, shape: Any) -> Any:
    a, b, c = shape
    value = np.empty((a, b, c), np.float32)
    for i in prange(a):
        x = origin[0] + i * BRICK * h
        for j in range(b):
            y = origin[1] + j * BRICK * h
            for k in range(c):
                away = nearest_distance(tree, x, y, origin[2] + k * BRICK * h, np.inf)
                inside = winding(columns, j * BRICK, k * BRICK, x) > 0
                value[i, j, k] = -away if inside else away
    return value


@pjit
def _choose_bricks(tree: Any, origin: Any, h: float, counts: Any) -> Any:
    a, b, c = counts
    reach = (_HALF_DIAGONAL + BAND_CELLS) * h
    brick = np.full((a, b, c), -1, np.int32)
    for i in prange(a):
        x = origin[0] + (i + 0.5) * BRICK * h
        for j in range(b):
            y = origin[1] + (j + 0.5) * BRICK * h
            for k in range(c):
                z = origin[2] + (k + 0.5) * BRICK * h
                if nearest_distance(tree, x, y, z, reach) < reach:
                    brick[i, j, k] = 0
    return brick


@pjit
def _overshoot(tree: Any, coarse: Any, brick: Any, origin: Any, h: float) -> Any:
    """How far reads between coarse samples exceed the exact depth, at points half a cell apart.

    Asked at the middles of inner cells, of their faces and edges, (2 a + 1, 2 b + 1, 2 c + 1).
    """
    a, b, c = brick.shape
    over = np.zeros((2 * a + 1, 2 * b + 1, 2 * c + 1), np.float32)
    for p in prange(2 * a + 1):
        i = min(int(np.int64(p)) // 2, a - 1)
        for q in range(2 * b + 1):
            j = min(q // 2, b - 1)
            for r in range(2 * c + 1):
                k = min(r // 2, c - 1)
                if p % 2 + q % 2 + r % 2 == 0 or not _by_inner_cell(coarse, brick, p, q, r):
                    continue
                depth = -mix(coarse, i, j, k, 0.5 * p - i, 0.5 * q - j, 0.5 * r - k)
                x = origin[0] + 0.5 * p * BRICK * h
                y = origin[1] + 0.5 * q * BRICK * h
                z = origin[2] + 0.5 * r * BRICK * h
                over[p, q, r] = max(0.0, depth - nearest_distance(tree, x, y, z, depth))
    return over


@jit
def _by_inner_cell(coarse: Any, brick: Any, p: int, q: int, r: int) -> bool:
    """Whether a point of the half-cell lattice bounds or lies in an inner cell without a brick."""
    a, b, c = brick.shape
    for i in range(max(0, (p - 1) // 2), min(a, p // 2 + 1)):
        for j in range(max(0, (q - 1) // 2), min(b, q // 2 + 1)):
            for k in range(max(0, (r - 1) // 2), min(c, r // 2 + 1)):
                if brick[i, j, k] < 0 and coarse[i, j, k] <= 0.0:
                    return True
    return False


def _lowered(tree: Any, coarse: Any, brick: Any, origin: FloatArray, h: float) -> Any:
    """Coarse samples with depths lowered so that reads between them aren't too deep.

    Where the distance is convex (around a re-entrant edge) a linear read between coarse
    samples exceeds it; each corner is lowered by the largest excess of the cells it serves.
    """
    each = maximum_filter(_overshoot(tree, coarse, brick, origin, h), size=3)[1::2, 1::2, 1::2]
    over = np.pad(np.where((brick < 0) & (coarse[:-1, :-1, :-1] <= 0), each, 0), 1)
    most = np.zeros_like(coarse)
    for shift in np.ndindex(2, 2, 2):
        window = tuple(slice(s, s + n) for s, n in zip(shift, coarse.shape, strict=True))
        most = np.maximum(most, over[window])
    return coarse + np.where(coarse < 0, most, 0).astype(np.float32)


@pjit
def _measure_bricks(tree: Any, grid: Any, places: Any) -> Any:
    error = np.zeros(len(places))
    deepest = np.zeros(len(places))
    h = grid.spacing
    for n in prange(len(places)):
        deepest[n] = -grid.samples[n].min()
        # One cell centre in each octant, in turn another one.
        for octant in range(8):
            i = 4 * (octant & 1) + n % 4
            j = 2 * (octant & 2) + (n // 4) % 4
            k = (octant & 4) + (n // 16) % 4
            x = grid.origin[0] + (places[n, 0] * BRICK + i + 0.5) * h
            y = grid.origin[1] + (places[n, 1] * BRICK + j + 0.5) * h
            z = grid.origin[2] + (places[n, 2] * BRICK + k + 0.5) * h
            depth = -read(grid, x, y, z)
            if depth > 0.0:
                exact = nearest_distance(tree, x, y, z, np.inf)
                error[n] = max(error[n], depth - exact)
    return error, deepest


def _measure(tree: TriangleTree, arrays: GridArrays, places: Any) -> tuple[float, float]:
    """Largest reading above the exact depth at cell centres tried, and the deepest sample."""
    error, deepest = _measure_bricks(tree, arrays, places)
    return float(error.max(initial=0.0)), float(deepest.max(initial=0.0))


_SIDE = BRICK + 1
_GROUP = 27
_ROOM = 32
"""Points measured at a time: a group and as many more as leave no processor's vector half full."""
_GROUP_HALF_DIAGONAL = sqrt(3.0)
_CHUNK = 16
_A_LITTLE_MORE = 1.0 + 1e-6
"""Beyond what rounding blurs of a distance."""
_TINY = 1e-300
"""Squared length, mm², below which an edge is a point."""


@jit
def winding(columns: Columns, j: int, k: int, x: float) -> int:
    """Winding number at place ``x`` of line (j, k)."""
    line = j * columns.shape[1] + k
    total = 0
    for i in range(columns.start[line], columns.start[line + 1]):
        if columns.where[i] > x:
            break
        total += columns.turn[i]
    return total


@pjit
def fill_bricks(tree: Any, columns: Any, origin: Any, h: float, places: Any) -> Any:
    """Signed distances of all samples of the bricks at ``places`` (n, 3), (n, 9, 9, 9), mm."""
    samples = np.empty((len(places), _SIDE, _SIDE, _SIDE), np.float32)
    chunks = (len(places) + _CHUNK - 1) // _CHUNK
    for chunk in prange(chunks):
        near = np.empty(len(tree.triangles), np.int32)
        for n in range(chunk * _CHUNK, min(len(places), (chunk + 1) * _CHUNK)):
            _fill_brick(tree, columns, origin, h, places[n], near, samples[n])
    return samples


@jit
def _fill_brick(
    tree: Any, columns: Any, origin: Any, h: float, place: Any, near: Any, out: Any
) -> None:
    """Exact signed distances of a brick's samples.

    A sample's nearest triangle is no farther from the brick's centre than the centre's own
    nearest plus a diagonal. In each of the 27 groups of 3 x 3 x 3 samples the triangle nearest to
    the middle bounds all samples' distances, so few others are left to be measured: those that
    `_may_serve` some sample.
    """
    cx = origin[0] + (place[0] + 0.5) * BRICK * h
    cy = origin[1] + (place[1] + 0.5) * BRICK * h
    cz = origin[2] + (place[2] + 0.5) * BRICK * h
    central = nearest_distance(tree, cx, cy, cz, np.inf)
    size = gather_within(tree, cx, cy, cz, (central + 2.0 * _HALF_DIAGONAL * h) * 1.0001, near)
    size = _kept(tree, cx, cy, cz, h, near, size)
    where, offset = np.empty((3, _ROOM)), np.empty((3, _ROOM))
    _cube(0.0, 0.0, 0.0, h, offset)
    _cube(cx, cy, cz, 3.0 * h, where)
    middles = where.copy()
    squared, way = np.empty((size, _ROOM)), np.empty((size, 3, _ROOM))
    for n in range(size):
        _ways(tree.triangles[near[n]], where, squared[n], way[n])
    best, reach = np.empty(_ROOM), np.empty(_ROOM)
    for group in range(_GROUP):
        _cube(middles[0, group], middles[1, group], middles[2, group], h, where)
        first = squared[:, group].argmin()
        best[:] = np.inf
        _nearer(tree.triangles[near[first]], where, best)
        # What serves some sample better is no farther from the middle than this.
        farthest = (sqrt(best.max()) + _GROUP_HALF_DIAGONAL * h) * 1.0001
        _reaches(best, reach)
        for n in range(size):
            away = squared[n, group]
            if n == first or away > farthest * farthest:
                continue
            if _may_serve(away, way[n, :, group], offset, reach, 1e-6 * h):
                _nearer(tree.triangles[near[n]], where, best)
                _reaches(best, reach)
        for m in range(_GROUP):
            i = 3 * (group // 9) + m // 9
            j = 3 * (group // 3 % 3) + m // 3 % 3
            k = 3 * (group % 3) + m % 3
            away = sqrt(best[m])
            turns = winding(columns, place[1] * BRICK + j, place[2] * BRICK + k, where[0, m])
            out[i, j, k] = -away if turns > 0 else away


@jit
def _kept(tree: Any, cx: float, cy: float, cz: float, h: float, near: Any, size: int) -> int:
    """Keep those triangles ``near`` that may serve a place of a brick; return how many.

    What one triangle's distance exceeds another's lower bound by is convex too: it is greatest in a
    corner of the brick.
    """
    centre, corner, offset = np.empty((3, 1)), np.empty((3, 8)), np.empty((3, 8))
    centre[0, 0], centre[1, 0], centre[2, 0] = cx, cy, cz
    for m in range(8):
        for axis in range(3):
            offset[axis, m] = (float(m >> axis & 1) - 0.5) * BRICK * h
            corner[axis, m] = centre[axis, 0] + offset[axis, m]
    squared, way = np.empty((size, 1)), np.empty((size, 3, 1))
    for n in range(size):
        _ways(tree.triangles[near[n]], centre, squared[n], way[n])
    first = squared[:, 0].argmin()
    reach = np.full(8, np.inf)
    _nearer(tree.triangles[near[first]], corner, reach)
    _reaches(reach, reach)
    count = 0
    for n in range(size):
        if n == first or _may_serve(squared[n, 0], way[n, :, 0], offset, reach, 1e-6 * h):
            near[count] = near[n]
            count += 1
    return count


@jit
def _reaches(best: Any, reach: Any) -> None:
    """Write the distances of squares ``best`` (n,), and a little more, into ``reach``."""
    for m in range(len(reach)):
        reach[m] = sqrt(best[m]) * _A_LITTLE_MORE


@jit
def _may_serve(squared: float, way: Any, offset: Any, reach: Any, slack: float) -> bool:
    """Whether a triangle may be nearer to any sample of a group than ``reach`` (n,).

    The distance from a triangle is convex: at ``offset`` (3, n) from a place it is at least that
    of the place plus the offset's part along the way (3,) there from the triangle's nearest point.
    """
    away = sqrt(squared)
    per = 1.0 / away if away > _TINY else 0.0
    x, y, z = way[0] * per, way[1] * per, way[2] * per
    away -= slack
    near = 0
    for m in range(len(reach)):
        near += away + x * offset[0, m] + y * offset[1, m] + z * offset[2, m] < reach[m]
    return near > 0


@jit
def _cube(x: float, y: float, z: float, step: float, where: Any) -> None:
    """Write 3 x 3 x 3 points a step apart, around one, into ``where`` (3, 32); z runs fastest.

    The last is repeated to the end.
    """
    for m in range(_ROOM):
        n = min(m, _GROUP - 1)
        where[0, m] = x + (n // 9 - 1) * step
        where[1, m] = y + (n // 3 % 3 - 1) * step
        where[2, m] = z + (n % 3 - 1) * step


@jit
def _nearer(tri: Any, where: Any, best: Any) -> None:
    """Lower the squared distances ``best`` of points ``where`` (3, n) to those from a triangle.

    Within the prism over the triangle that is its plane's, elsewhere the nearest edge's. Without
    branches, so that one instruction takes several points. A sliver counts as its edges.
    """
    ax, ay, az = tri[0], tri[1], tri[2]
    bx, by, bz = tri[3], tri[4], tri[5]
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = tri[6] - bx, tri[7] - by, tri[8] - bz
    wx, wy, wz = ax - tri[6], ay - tri[7], az - tri[8]
    uu, vv, ww = (
        ux * ux + uy * uy + uz * uz,
        vx * vx + vy * vy + vz * vz,
        wx * wx + wy * wy + wz * wz,
    )
    per_u, per_v, per_w = 1.0 / max(uu, _TINY), 1.0 / max(vv, _TINY), 1.0 / max(ww, _TINY)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    flat = nn <= SLIVER * uu * ww
    per_n = 0.0 if flat else 1.0 / nn
    never = 1.0 if flat else 0.0
    for m in range(where.shape[1]):
        px, py, pz = where[0, m] - ax, where[1, m] - ay, where[2, m] - az
        qx, qy, qz = where[0, m] - bx, where[1, m] - by, where[2, m] - bz
        rx, ry, rz = px + wx, py + wy, pz + wz
        s = min(1.0, max(0.0, (px * ux + py * uy + pz * uz) * per_u))
        ex, ey, ez = px - s * ux, py - s * uy, pz - s * uz
        on_u = ex * ex + ey * ey + ez * ez
        s = min(1.0, max(0.0, (qx * vx + qy * vy + qz * vz) * per_v))
        ex, ey, ez = qx - s * vx, qy - s * vy, qz - s * vz
        on_v = ex * ex + ey * ey + ez * ez
        s = min(1.0, max(0.0, (rx * wx + ry * wy + rz * wz) * per_w))
        ex, ey, ez = rx - s * wx, ry - s * wy, rz - s * wz
        on_w = ex * ex + ey * ey + ez * ez
        # Volumes: on which side of each edge the point lies.
        side_u = px * (uy * nz - uz * ny) + py * (uz * nx - ux * nz) + pz * (ux * ny - uy * nx)
        side_v = qx * (vy * nz - vz * ny) + qy * (vz * nx - vx * nz) + qz * (vx * ny - vy * nx)
        side_w = rx * (wy * nz - wz * ny) + ry * (wz * nx - wx * nz) + rz * (wx * ny - wy * nx)
        outside = max(max(side_u, side_v), max(side_w, never))
        height = px * nx + py * ny + pz * nz
        plane = height * height * per_n
        edge = min(min(on_u, on_v), on_w)
        best[m] = min(best[m], edge if outside > 0.0 else plane)


@jit
def _ways(tri: Any, where: Any, squared: Any, way: Any) -> None:
    """Ways (3, n) to points ``where`` (3, n) from a triangle's nearest points, and their squares.

    As `_nearer`, without branches.
    """
    ax, ay, az = tri[0], tri[1], tri[2]
    bx, by, bz = tri[3], tri[4], tri[5]
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = tri[6] - bx, tri[7] - by, tri[8] - bz
    wx, wy, wz = ax - tri[6], ay - tri[7], az - tri[8]
    uu, vv, ww = (
        ux * ux + uy * uy + uz * uz,
        vx * vx + vy * vy + vz * vz,
        wx * wx + wy * wy + wz * wz,
    )
    per_u, per_v, per_w = 1.0 / max(uu, _TINY), 1.0 / max(vv, _TINY), 1.0 / max(ww, _TINY)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    flat = nn <= SLIVER * uu * ww
    per_n = 0.0 if flat else 1.0 / nn
    never = 1.0 if flat else 0.0
    for m in range(where.shape[1]):
        px, py, pz = where[0, m] - ax, where[1, m] - ay, where[2, m] - az
        qx, qy, qz = where[0, m] - bx, where[1, m] - by, where[2, m] - bz
        rx, ry, rz = px + wx, py + wy, pz + wz
        s = min(1.0, max(0.0, (px * ux + py * uy + pz * uz) * per_u))
        ex, ey, ez = px - s * ux, py - s * uy, pz - s * uz
        best = ex * ex + ey * ey + ez * ez
        s = min(1.0, max(0.0, (qx * vx + qy * vy + qz * vz) * per_v))
        fx, fy, fz = qx - s * vx, qy - s * vy, qz - s * vz
        away = fx * fx + fy * fy + fz * fz
        ex, ey, ez = (
            fx if away < best else ex,
            fy if away < best else ey,
            fz if away < best else ez,
        )
        best = min(best, away)
        s = min(1.0, max(0.0, (rx * wx + ry * wy + rz * wz) * per_w))
        fx, fy, fz = rx - s * wx, ry - s * wy, rz - s * wz
        away = fx * fx + fy * fy + fz * fz
        ex, ey, ez = (
            fx if away < best else ex,
            fy if away < best else ey,
            fz if away < best else ez,
        )
        side_u = px * (uy * nz - uz * ny) + py * (uz * nx - ux * nz) + pz * (ux * ny - uy * nx)
        side_v = qx * (vy * nz - vz * ny) + qy * (vz * nx - vx * nz) + qz * (vx * ny - vy * nx)
        side_w = rx * (wy * nz - wz * ny) + ry * (wz * nx - wx * nz) + rz * (wx * ny - wy * nx)
        outside = max(max(side_u, side_v), max(side_w, never)) > 0.0
        height = (px * nx + py * ny + pz * nz) * per_n
        x = ex if outside else height * nx
        y = ey if outside else height * ny
        z = ez if outside else height * nz
        way[0, m], way[1, m], way[2, m] = x, y, z
        squared[m] = x * x + y * y + z * z
