"""Compute the distance from a lumen point along a ray to the first printed line (compiled).

Written layers are slabs; in each, a line is a stadium seen from above, whose flanks are half
ellipses over the slab's height: round, or straight where they are not deep. A ray's way to the
first line is exact: in every slab that it passes, it meets stadiums in plan, and in these the
flanks.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels import jit
from kernels.arrays import FloatArray, IntArray


class RayRules(NamedTuple):
    """Tolerances of a ray's way to a flank."""

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
def _row_cells(
    x0: float, y0: float, x1: float, y1: float, half: float, y_low: float, y_high: float
) -> tuple[float, float]:
    """Hull in x of that part of a stadium whose y is in a strip; (1, 0) when there is none."""
    a, b = y_low - half, y_high + half
    if max(y0, y1) < a or min(y0, y1) > b:
        return 1.0, 0.0
    t0, t1 = 0.0, 1.0
    dy = y1 - y0
    if abs(dy) > RAY.flat:
        ta, tb = (a - y0) / dy, (b - y0) / dy
        t0, t1 = max(0.0, min(ta, tb)), min(1.0, max(ta, tb))
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
        j0 = max(0, int(np.floor((min(y0, y1) - half - bottom) / cell)))
        j1 = min(ny - 1, int(np.floor((max(y0, y1) + half - bottom) / cell)))
        for j in range(j0, j1 + 1):
            edge = bottom + j * cell
            low, high = _row_cells(x0, y0, x1, y1, half, edge, edge + cell)
            if low > high:
                continue
            i0 = max(0, int(np.floor((low - left) / cell)))
            i1 = min(nx - 1, int(np.floor((high - left) / cell)))
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
        i0 = max(0, int(np.floor((x - reach[n, 0] - left) / cell)))
        i1 = min(nx - 1, int(np.floor((x + reach[n, 0] - left) / cell)))
        j0 = max(0, int(np.floor((y - reach[n, 1] - bottom) / cell)))
        j1 = min(ny - 1, int(np.floor((y + reach[n, 1] - bottom) / cell)))
        needed[k0 : k1 + 1, j0 : j1 + 1, i0 : i1 + 1] = True


@jit
def stadium_span(
    px: float,
    py: float,
    dx: float,
    dy: float,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    half: float,
) -> tuple[float, float]:
    """Between which t the point p + t d is in a stadium; (1, 0) where never.

    A stadium is convex, so the span is the hull of what its two discs and its rectangle give.
    """
    square = dx * dx + dy * dy
    # Both ends on one side of the ray, and farther than half the width: most lines are.
    side0 = dx * (y0 - py) - dy * (x0 - px)
    side1 = dx * (y1 - py) - dy * (x1 - px)
    if side0 * side1 > 0.0 and min(side0 * side0, side1 * side1) > half * half * square:
        return 1.0, 0.0
    low, high = np.inf, -np.inf
    for cx, cy in ((x0 - px, y0 - py), (x1 - px, y1 - py)):
        along = dx * cx + dy * cy
        rest = along * along - square * (cx * cx + cy * cy - half * half)
        if rest >= 0.0:
            root = np.sqrt(rest)
            low, high = min(low, (along - root) / square), max(high, (along + root) / square)
    lx, ly = x1 - x0, y1 - y0
    length = np.sqrt(lx * lx + ly * ly)
    if length > 0.0:
        lx, ly = lx / length, ly / length
        s, ds = (px - x0) * lx + (py - y0) * ly, dx * lx + dy * ly
        n, dn = (py - y0) * lx - (px - x0) * ly, dy * lx - dx * ly
        a0, a1 = -np.inf, np.inf
        if abs(ds) > RAY.flat:
            ta, tb = -s / ds, (length - s) / ds
            a0, a1 = min(ta, tb), max(ta, tb)
        elif s < 0.0 or s > length:
            a0, a1 = 1.0, 0.0
        if abs(dn) > RAY.flat:
            ta, tb = (-half - n) / dn, (half - n) / dn
            a0, a1 = max(a0, min(ta, tb)), min(a1, max(ta, tb))
        elif abs(n) > half:
            a0, a1 = 1.0, 0.0
        if a0 <= a1:
            low, high = min(low, a0), max(high, a1)
    if low > high:
        return 1.0, 0.0
    return low, high


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
        tip = RAY.rim * rise
        t0, t1 = (-rise - up) / dz, (rise - up) / dz
        t0, t1 = min(t0, t1), max(t0, t1)
        if t0 > tb or t1 < ta:
            return np.inf
        if t0 >= ta:
            face = _flank(line, px + t0 * dx, py + t0 * dy, up + t0 * dz)[0]
            if face <= 0.0:
                return t0
        # On the rim itself the flank lies level, and its gradient isn't finite.
        t0, t1 = min((-tip - up) / dz, (tip - up) / dz), max((-tip - up) / dz, (tip - up) / dz)
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
        ta, tb = (slabs.low[k] - pz) / dz, (slabs.high[k] - pz) / dz
        ta, tb = max(0.0, min(ta, tb)), min(limit, max(ta, tb))
        if ta >= limit:
            break
        if tb >= ta:
            hit = _hit_in_layer(slabs, k, px, py, pz, dx, dy, dz, ta, tb)
            if hit < limit:
                return hit
        k += step
    return limit
