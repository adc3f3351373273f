"""Measure a lumen section's largest open circle and open area between printed lines (compiled)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np

from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray
from sim.gcode.lumens.ray_kernels import Slabs, first_hit


class CircleSearch(NamedTuple):
    """Search for the widest circle in a lumen."""

    spiral_points: int = 40  # Points tried in a lumen whose axis a line covers.
    coarse_rays: int = 24
    golden_angle: float = 2.399963229728653
    settled_mm: float = 4e-4  # A circle that grows by less on moving its centre is the widest.
    max_cells: int = 2000


CIRCLE: Final = CircleSearch()


@jit
def _look_round(
    slabs: Slabs, point: FloatArray, u: FloatArray, v: FloatArray, limit: float, sight: FloatArray
) -> float:
    """Fill ``sight`` with the way to the first line, all round; returns the shortest."""
    rays = len(sight)
    least = limit
    for k in range(rays):
        angle = 2.0 * np.pi * k / rays
        c, s = np.cos(angle), np.sin(angle)
        sight[k] = first_hit(
            slabs,
            point[0],
            point[1],
            point[2],
            c * u[0] + s * v[0],
            c * u[1] + s * v[1],
            c * u[2] + s * v[2],
            limit,
        )
        least = min(least, sight[k])
        if least <= 0.0:
            break
    return least


@jit
def _without_slits(sight: FloatArray, clean: FloatArray) -> None:
    """Cut a ray down to the longer of its neighbours: one alone looks into a slit between lines."""
    n = len(sight)
    for k in range(n):
        clean[k] = min(sight[k], max(sight[k - 1], sight[(k + 1) % n]))


@jit
def _edges(corner: FloatArray) -> FloatArray:
    """A polygon's edges, (n, 5): where each begins, its way, and 1 / length²."""
    n = len(corner)
    edge = np.empty((n, 5))
    for k in range(n):
        lx, ly = corner[k, 0] - corner[k - 1, 0], corner[k, 1] - corner[k - 1, 1]
        square = lx * lx + ly * ly
        edge[k, 0], edge[k, 1] = corner[k - 1, 0], corner[k - 1, 1]
        edge[k, 2], edge[k, 3] = lx, ly
        edge[k, 4] = 1.0 / square if square > 0.0 else 0.0
    return edge


@jit
def _clearance(edge: FloatArray, x: float, y: float) -> float:
    """Distance from a point to a polygon's edges; negative outside."""
    inside = False
    best = np.inf
    for k in range(len(edge)):
        ax, ay, lx, ly = edge[k, 0], edge[k, 1], edge[k, 2], edge[k, 3]
        if (ay > y) != (ay + ly > y) and (x - ax - lx * (y - ay) / ly) < 0.0:
            inside = not inside
        t = ((x - ax) * lx + (y - ay) * ly) * edge[k, 4]
        t = min(1.0, max(0.0, t))
        ex, ey = x - ax - t * lx, y - ay - t * ly
        best = min(best, ex * ex + ey * ey)
    distance = np.sqrt(best)
    return distance if inside else -distance


@jit
def widest_in_polygon(
    corner: FloatArray, ax: float, ay: float, window: float, tolerance: float
) -> tuple[float, float, float]:
    """Centre and radius of the widest circle in a polygon, its centre within ``window`` of a.

    Branch and bound over squares, the larger first: no circle whose centre lies in a square of
    half edge h is wider than the clearance at its middle plus h √2.
    """
    edge = _edges(corner)
    bx, by = ax, ay
    best = _clearance(edge, ax, ay)
    if best < 0.0:
        bx, by, best = 0.0, 0.0, _clearance(edge, 0.0, 0.0)
    square = np.empty((CIRCLE.max_cells + 8, 4))
    square[0] = ax, ay, window, np.inf
    taken, used, tried = 0, 1, 0
    while taken < used and tried < CIRCLE.max_cells:
        x, y, half, bound = square[taken]
        taken += 1
        if bound <= best + tolerance:
            continue
        half *= 0.5
        for sx in (-half, half):
            for sy in (-half, half):
                cx, cy = x + sx, y + sy
                away = np.sqrt((cx - ax) ** 2 + (cy - ay) ** 2)
                if away > window + half * np.sqrt(2.0):
                    continue
                tried += 1
                clear = _clearance(edge, cx, cy)
                if clear > best and away <= window:
                    bx, by, best = cx, cy, clear
                if clear + half * np.sqrt(2.0) > best + tolerance:
                    square[used] = cx, cy, half, clear + half * np.sqrt(2.0)
                    used += 1
    return bx, by, best


@jit
def _settle(
    slabs: Slabs,
    axis: FloatArray,
    u: FloatArray,
    v: FloatArray,
    window: float,
    limit: float,
    start: FloatArray,
    sight: FloatArray,
) -> tuple[float, float, float]:
    """Move from ``start`` (2,) in the plane to where the widest circle is: x, y, radius."""
    rays = len(sight)
    point = np.empty(3)
    seen, clean, corner = np.empty(rays), np.empty(rays), np.empty((rays, 2))
    best_x, best_y, best = start[0], start[1], -1.0
    x, y = start
    for _ in range(5):
        for c in range(3):
            point[c] = axis[c] + x * u[c] + y * v[c]
        least = _look_round(slabs, point, u, v, limit, seen)
        if least <= 0.0:
            break
        if least <= best + CIRCLE.settled_mm:
            if least > best:
                best_x, best_y, best = x, y, least
                sight[:] = seen
            break
        best_x, best_y, best = x, y, least
        sight[:] = seen
        _without_slits(seen, clean)
        for k in range(rays):
            angle = 2.0 * np.pi * k / rays
            corner[k, 0], corner[k, 1] = clean[k] * np.cos(angle), clean[k] * np.sin(angle)
        cx, cy, _ = widest_in_polygon(corner, -x, -y, window, CIRCLE.settled_mm)
        x, y = x + cx, y + cy
    return best_x, best_y, best


@jit
def _section(
    slabs: Slabs,
    axis: FloatArray,
    along: FloatArray,
    radius: float,
    window: float,
    limit: float,
    rays: int,
) -> tuple[float, float, float, float, float]:
    """Widest circle's diameter, its centre, and the area seen from there; see `sections`."""
    u, v = np.empty(3), np.empty(3)
    flat = np.sqrt(along[0] ** 2 + along[1] ** 2)
    if flat < 1e-9:
        u[:] = 1.0, 0.0, 0.0
        v[:] = 0.0, 1.0, 0.0
    else:
        u[:] = -along[1] / flat, along[0] / flat, 0.0
        v[:] = -along[2] * u[1], along[2] * u[0], along[0] * u[1] - along[1] * u[0]
    sight, other = np.empty(rays), np.empty(rays)
    start = np.zeros(2)
    x, y, best = _settle(slabs, axis, u, v, window, limit, start, sight)
    if best < 0.75 * radius:
        # A line stands in the lumen: look at the other side of it too.
        coarse, point, clear = np.empty(CIRCLE.coarse_rays), np.empty(3), 0.0
        for k in range(CIRCLE.spiral_points):
            away = window * np.sqrt((k + 0.5) / CIRCLE.spiral_points)
            px, py = away * np.cos(k * CIRCLE.golden_angle), away * np.sin(k * CIRCLE.golden_angle)
            for c in range(3):
                point[c] = axis[c] + px * u[c] + py * v[c]
            least = _look_round(slabs, point, u, v, limit, coarse)
            if least > clear:
                clear = least
                start[0], start[1] = px, py
        if clear > 0.0:
            ox, oy, diameter = _settle(slabs, axis, u, v, window, limit, start, other)
            if diameter > best:
                x, y, best = ox, oy, diameter
                sight[:] = other
    if best <= 0.0:
        return 0.0, axis[0], axis[1], axis[2], 0.0
    _without_slits(sight, other)
    area = 0.0
    for k in range(rays):
        way = radius if other[k] >= limit else other[k]
        area += way * way * np.pi / rays
    return (
        2.0 * best,
        axis[0] + x * u[0] + y * v[0],
        axis[1] + x * u[1] + y * v[1],
        axis[2] + x * u[2] + y * v[2],
        area,
    )


@pjit
def sections(
    slabs: Slabs,
    axis: FloatArray,
    along: FloatArray,
    radius: FloatArray,
    window: FloatArray,
    limit: FloatArray,
    rays: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure the open section at each station, in the plane across ``along``.

    Parameters
    ----------
    axis, along : (n, 3) float64, mm
        A point of the lumen, and the unit vector of its way.
    radius : (n,) float64, mm
        Designed. A ray that meets no line within the limit looks into another lumen or out of a
        port, and counts as this long in the area.
    window, limit : (n,) float64, mm
        How far the circle's centre may lie from the axis, and how far is looked.
    rays : (n,) int64

    Returns
    -------
    diameter : (n,) float64, mm
        Of the widest circle; 0 where ink covers the lumen.
    centre : (n, 3) float64, mm
        Its centre; the axis where there is none.
    area : (n,) float64, mm²
        Seen from that centre.
    """
    n = len(axis)
    diameter, area, centre = np.zeros(n), np.zeros(n), np.zeros((n, 3))
    for k in numba.prange(n):
        d, x, y, z, a = _section(slabs, axis[k], along[k], radius[k], window[k], limit[k], rays[k])
        diameter[k], area[k] = d, a
        centre[k, 0], centre[k, 1], centre[k, 2] = x, y, z
    return diameter, centre, area
