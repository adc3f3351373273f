"""Compute exact signed distances at the samples of fine blocks of a tissue's distance grid."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange

from design.geometry import gather_within, nearest_distance
from design.geometry.segments import SLIVER
from design.tissue.arrays import BRICK
from design.tissue.columns import Columns
from kernels import jit, pjit

_SIDE = BRICK + 1
_HALF_DIAGONAL = 0.5 * BRICK * sqrt(3.0)
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
