"""Measure a lumen section's largest open circle and open area between printed lines (compiled)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from gcode.deposit.kernels import band_span, stadium_span
from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray


class RayRules(NamedTuple):
    """Tolerances of a ray's way to a flank.

    Written layers are slabs; in each, a line is a stadium seen from above, whose flanks are half
    ellipses over the slab's height: round, or straight where they are not deep. A ray's way to the
    first line is exact: in every slab that it passes, it meets stadiums in plan, and in these the
    flanks.
    """

    flat: float = 1e-12
    rim: float = 1.0 - 1e-4  # Share of its half height up to which a flank is followed.
    settled_mm: float = 1e-7
    max_steps: int = 30


RAY: Final = RayRules()


class Slabs(NamedTuple):
    """Written lines by layer and cell.

    Attributes
    ----------
    low, high : (k,) float64, mm
        Of each layer, ascending and disjoint.
    line : (n, 7) float64, mm
        x, y of both ends, half the width, the depth of a flank's ellipse and half its height.
    first : (k * ny * nx + 1,) int64
        Where each cell's lines begin in ``item``; x runs fastest.
    item : (m,) int32
        Lines that reach into the cell.
    left, bottom, cell : float, mm
        Corner of the grid, and a cell's edge.
    """

    low: FloatArray
    high: FloatArray
    line: FloatArray
    first: IntArray
    item: NDArray[np.int32]
    left: float
    bottom: float
    cell: float
    nx: int
    ny: int


@jit
def cells_between(
    low: float, high: float, origin: float, cell: float, count: int
) -> tuple[int, int]:
    """Return the first and last of a row's cells that reach into [low, high]."""
    first, last = int(np.floor((low - origin) / cell)), int(np.floor((high - origin) / cell))
    return max(0, first), min(count - 1, last)


@jit
def _row_cells(
    x0: float, y0: float, x1: float, y1: float, half: float, y_low: float, y_high: float
) -> tuple[float, float]:
    """Hull in x of that part of a stadium whose y is in a strip; (1, 0) when there is none."""
    t0, t1 = band_span(y0, y1 - y0, y_low - half, y_high + half)
    t0, t1 = max(0.0, t0), min(1.0, t1)
    if t0 > t1:
        return 1.0, 0.0
    xa, xb = x0 + t0 * (x1 - x0), x0 + t1 * (x1 - x0)
    return min(xa, xb) - half, max(xa, xb) + half


@jit
def list_cells(
    line: FloatArray,
    layer: IntArray,
    needed: NDArray[np.bool_],
    left: float,
    bottom: float,
    cell: float,
    first: IntArray,
    item: NDArray[np.int32],
    fill: bool,
) -> None:
    """Count the lines of each needed cell into ``first[c + 1]``, or put them at ``first[c]``.

    ``needed`` is (layers, ny, nx). Filling moves ``first`` on by each cell's count.
    """
    _, ny, nx = needed.shape
    for n in range(len(line)):
        x0, y0, x1, y1, half = line[n, :5]
        j0, j1 = cells_between(min(y0, y1) - half, max(y0, y1) + half, bottom, cell, ny)
        for j in range(j0, j1 + 1):
            edge = bottom + j * cell
            low, high = _row_cells(x0, y0, x1, y1, half, edge, edge + cell)
            if low > high:
                continue
            i0, i1 = cells_between(low, high, left, cell, nx)
            for i in range(i0, i1 + 1):
                if needed[layer[n], j, i]:
                    where = (layer[n] * ny + j) * nx + i
                    if fill:
                        item[first[where]] = n
                        first[where] += 1
                    else:
                        first[where + 1] += 1


@jit
def mark_needed(
    centre: FloatArray,
    reach: FloatArray,
    low: FloatArray,
    high: FloatArray,
    left: float,
    bottom: float,
    cell: float,
    needed: NDArray[np.bool_],
) -> None:
    """Mark the cells that a section may ask for: a box of half edges ``reach`` (n, 3) each."""
    layers, ny, nx = needed.shape
    for n in range(len(centre)):
        x, y, z = centre[n]
        k0 = max(0, np.searchsorted(high, z - reach[n, 2]) - 1)
        k1 = min(layers - 1, np.searchsorted(low, z + reach[n, 2]) + 1)
        i0, i1 = cells_between(x - reach[n, 0], x + reach[n, 0], left, cell, nx)
        j0, j1 = cells_between(y - reach[n, 1], y + reach[n, 1], bottom, cell, ny)
        needed[k0 : k1 + 1, j0 : j1 + 1, i0 : i1 + 1] = True


@jit
def _flank(line: FloatArray, x: float, y: float, up: float) -> tuple[float, float, float, float]:
    """How far a point ``up`` above a line's middle is outside it, and the gradient in x, y, z."""
    x0, y0, x1, y1, half, deep, rise = line
    lx, ly = x1 - x0, y1 - y0
    square = lx * lx + ly * ly
    t = ((x - x0) * lx + (y - y0) * ly) / square if square > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    ex, ey = x - x0 - t * lx, y - y0 - t * ly
    away = np.sqrt(ex * ex + ey * ey)
    u = up / rise
    rest = np.sqrt(max(1.0 - u * u, 0.0))
    steep = deep * u / (rise * max(rest, RAY.flat))
    scale = 1.0 / max(away, RAY.flat)
    return away - half + deep * (1.0 - rest), ex * scale, ey * scale, steep


@jit
def _enters(
    line: FloatArray,
    px: float,
    py: float,
    up: float,
    dx: float,
    dy: float,
    dz: float,
    ta: float,
    tb: float,
) -> float:
    """First t in [ta, tb] at which a ray is in a line; inf where never.

    ``up`` is how far the ray begins above the line's middle. A line is convex, and so is how far a
    point of the ray is outside it: Newton's steps from outside come to its face from outside.
    """
    rise = line[6]
    if abs(dz) > RAY.flat:
        t0, t1 = band_span(up, dz, -rise, rise)
        if t0 > tb or t1 < ta:
            return np.inf
        if t0 >= ta:
            face = _flank(line, px + t0 * dx, py + t0 * dy, up + t0 * dz)[0]
            if face <= 0.0:
                return t0
        # On the rim itself the flank lies level, and its gradient isn't finite.
        t0, t1 = band_span(up, dz, -RAY.rim * rise, RAY.rim * rise)
        ta, tb = max(ta, t0), min(tb, t1)
    elif abs(up) > rise * (1.0 + RAY.settled_mm):
        return np.inf
    t = ta
    for _ in range(RAY.max_steps):
        if t > tb:
            return np.inf
        off, gx, gy, gz = _flank(line, px + t * dx, py + t * dy, up + t * dz)
        if off <= RAY.settled_mm:
            return t
        slope = gx * dx + gy * dy + gz * dz
        if slope >= 0.0:
            return np.inf
        t -= off / slope
    return t if t <= tb else np.inf


@jit
def _first_above(
    slabs: Slabs, layer: int, px: float, py: float, pz: float, dz: float, ta: float, tb: float
) -> float:
    """First t in [ta, tb] at which an upright ray is in a line of the layer; inf where never."""
    i = int(np.floor((px - slabs.left) / slabs.cell))
    j = int(np.floor((py - slabs.bottom) / slabs.cell))
    best = np.inf
    if i < 0 or j < 0 or i >= slabs.nx or j >= slabs.ny:
        return best
    up = pz - 0.5 * (slabs.low[layer] + slabs.high[layer])
    where = (layer * slabs.ny + j) * slabs.nx + i
    for at in range(slabs.first[where], slabs.first[where + 1]):
        line = slabs.line[slabs.item[at]]
        best = min(best, _enters(line, px, py, up, 0.0, 0.0, dz, ta, tb))
    return best


@jit
def _hit_in_layer(
    slabs: Slabs,
    layer: int,
    px: float,
    py: float,
    pz: float,
    dx: float,
    dy: float,
    dz: float,
    ta: float,
    tb: float,
) -> float:
    """First t in [ta, tb] at which p + t d is covered in one layer; inf where never."""
    if dx * dx + dy * dy < 1e-18:
        return _first_above(slabs, layer, px, py, pz, dz, ta, tb)
    cell = slabs.cell
    up = pz - 0.5 * (slabs.low[layer] + slabs.high[layer])
    i = int(np.floor((px + ta * dx - slabs.left) / cell))
    j = int(np.floor((py + ta * dy - slabs.bottom) / cell))
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    next_x, next_y, over_x, over_y = np.inf, np.inf, np.inf, np.inf
    if dx != 0.0:
        next_x = (slabs.left + (i + (step_i > 0)) * cell - px) / dx
        over_x = cell / abs(dx)
    if dy != 0.0:
        next_y = (slabs.bottom + (j + (step_j > 0)) * cell - py) / dy
        over_y = cell / abs(dy)
    best = np.inf
    while True:
        leaves = min(next_x, next_y)
        if 0 <= i < slabs.nx and 0 <= j < slabs.ny:
            where = (layer * slabs.ny + j) * slabs.nx + i
            for at in range(slabs.first[where], slabs.first[where + 1]):
                line = slabs.line[slabs.item[at]]
                low, high = stadium_span(
                    px, py, dx, dy, line[0], line[1], line[2], line[3], line[4]
                )
                low, high = max(low, ta), min(high, tb)
                if low <= high and low < best:
                    best = min(best, _enters(line, px, py, up, dx, dy, dz, low, high))
        if best <= leaves or leaves >= tb:
            return best
        if next_x < next_y:
            i += step_i
            next_x += over_x
        else:
            j += step_j
            next_y += over_y


@jit
def first_hit(
    slabs: Slabs,
    px: float,
    py: float,
    pz: float,
    dx: float,
    dy: float,
    dz: float,
    limit: float,
) -> float:
    """Way from a point along the unit vector d to the first line; ``limit`` where none is nearer.

    Above, below and between layers nothing is written.
    """
    layers = len(slabs.low)
    # Slabs hold their lower face, not their upper one.
    k = int(np.searchsorted(slabs.high, pz, side="right"))
    if abs(dz) < 1e-9:
        if k >= layers or pz < slabs.low[k]:
            return limit
        return min(limit, _hit_in_layer(slabs, k, px, py, pz, dx, dy, 0.0, 0.0, limit))
    step = 1 if dz > 0.0 else -1
    if step < 0 and (k >= layers or pz < slabs.low[k]):
        k -= 1
    while 0 <= k < layers:
        ta, tb = band_span(pz, dz, slabs.low[k], slabs.high[k])
        ta, tb = max(0.0, ta), min(limit, tb)
        if ta >= limit:
            break
        if tb >= ta:
            hit = _hit_in_layer(slabs, k, px, py, pz, dx, dy, dz, ta, tb)
            if hit < limit:
                return hit
        k += step
    return limit


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
def polygon_edges(corner: FloatArray) -> FloatArray:
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
def clearance(edge: FloatArray, x: float, y: float) -> float:
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
    edge = polygon_edges(corner)
    bx, by = ax, ay
    best = clearance(edge, ax, ay)
    if best < 0.0:
        bx, by, best = 0.0, 0.0, clearance(edge, 0.0, 0.0)
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
                clear = clearance(edge, cx, cy)
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
