"""Compute exact signed distances at the samples of fine blocks of a tissue's distance grid."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numba import prange

from design.geometry import gather_within, nearest_distance
from design.geometry.triangles import SLIVER
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
        found = np.empty(len(tree.triangles), np.int32)
        for n in range(chunk * _CHUNK, min(len(places), (chunk + 1) * _CHUNK)):
            _fill_brick(tree, columns, origin, h, places[n], found, samples[n])
    return samples


@jit
def _fill_brick(
    tree: Any, columns: Any, origin: Any, h: float, place: Any, found: Any, out: Any
) -> None:
    """Exact signed distances of a brick's samples.

    A sample's nearest triangle is no farther from the brick's centre than the centre's own
    nearest plus a diagonal. In each of the 27 groups of 3 x 3 x 3 samples the triangle nearest to
    the middle bounds all samples' distances, so few others are left to be measured.
    """
    cx = origin[0] + (place[0] + 0.5) * BRICK * h
    cy = origin[1] + (place[1] + 0.5) * BRICK * h
    cz = origin[2] + (place[2] + 0.5) * BRICK * h
    central = nearest_distance(tree, cx, cy, cz, np.inf)
    size = gather_within(tree, cx, cy, cz, (central + 2.0 * _HALF_DIAGONAL * h) * 1.0001, found)
    where = np.empty((3, _ROOM))
    _cube(cx, cy, cz, 3.0 * h, where)
    middles = where.copy()
    squared = np.full((size, _ROOM), np.inf)
    for n in range(size):
        _nearer(tree.triangles[found[n]], where, squared[n])
    best = np.empty(_ROOM)
    for group in range(_GROUP):
        _cube(middles[0, group], middles[1, group], middles[2, group], h, where)
        first = squared[:, group].argmin()
        best[:] = np.inf
        _nearer(tree.triangles[found[first]], where, best)
        # What serves some sample better is no farther from the middle than this.
        farthest = (sqrt(best.max()) + _GROUP_HALF_DIAGONAL * h) * 1.0001
        for n in range(size):
            if n != first and squared[n, group] <= farthest * farthest:
                _nearer(tree.triangles[found[n]], where, best)
        for m in range(_GROUP):
            i = 3 * (group // 9) + m // 9
            j = 3 * (group // 3 % 3) + m // 3 % 3
            k = 3 * (group % 3) + m % 3
            away = sqrt(best[m])
            turns = winding(columns, place[1] * BRICK + j, place[2] * BRICK + k, where[0, m])
            out[i, j, k] = -away if turns > 0 else away


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
    for m in range(_ROOM):
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
