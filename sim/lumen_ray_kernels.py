"""Kernels: how far one sees among the lines of a layered print.

Written layers are slabs; in each, a line is a stadium seen from above, with straight flanks over
the slab's height. A ray's way to the first line is exact: in every slab that it passes, it meets
stadiums in plan.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels import jit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

FLAT: Final = 1e-12


class Slabs(NamedTuple):
    """Written lines by layer and cell.

    Attributes
    ----------
    low, high : (k,) float64, mm
        Of each layer, ascending and disjoint.
    line : (n, 5) float64, mm
        x, y of both ends and half the width.
    first : (k * ny * nx + 1,) int64
        Where each cell's lines begin in ``item``; x runs fastest.
    item : (m,) int32
        Lines that reach into the cell.
    left, bottom, cell : float, mm
        Corner of the grid, and a cell's edge.
    nx, ny : int
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
    if abs(dy) > FLAT:
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
        x0, y0, x1, y1, half = line[n]
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
        if abs(ds) > FLAT:
            ta, tb = -s / ds, (length - s) / ds
            a0, a1 = min(ta, tb), max(ta, tb)
        elif s < 0.0 or s > length:
            a0, a1 = 1.0, 0.0
        if abs(dn) > FLAT:
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
def _covered(slabs: Slabs, layer: int, x: float, y: float) -> bool:
    """Whether a line of the layer covers the point."""
    i = int(np.floor((x - slabs.left) / slabs.cell))
    j = int(np.floor((y - slabs.bottom) / slabs.cell))
    if i < 0 or j < 0 or i >= slabs.nx or j >= slabs.ny:
        return False
    where = (layer * slabs.ny + j) * slabs.nx + i
    for at in range(slabs.first[where], slabs.first[where + 1]):
        x0, y0, x1, y1, half = slabs.line[slabs.item[at]]
        lx, ly = x1 - x0, y1 - y0
        square = lx * lx + ly * ly
        t = ((x - x0) * lx + (y - y0) * ly) / square if square > 0.0 else 0.0
        t = min(1.0, max(0.0, t))
        ex, ey = x - x0 - t * lx, y - y0 - t * ly
        if ex * ex + ey * ey < half * half:
            return True
    return False


@jit
def _hit_in_layer(
    slabs: Slabs, layer: int, px: float, py: float, dx: float, dy: float, ta: float, tb: float
) -> float:
    """First t in [ta, tb] at which p + t d is covered in one layer; inf where never."""
    if dx * dx + dy * dy < 1e-18:
        return ta if _covered(slabs, layer, px + ta * dx, py + ta * dy) else np.inf
    cell = slabs.cell
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
                x0, y0, x1, y1, half = slabs.line[slabs.item[at]]
                low, high = stadium_span(px, py, dx, dy, x0, y0, x1, y1, half)
                if low <= high and high >= ta and low <= tb:
                    best = min(best, max(low, ta))
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
        return min(limit, _hit_in_layer(slabs, k, px, py, dx, dy, 0.0, limit))
    step = 1 if dz > 0.0 else -1
    if step < 0 and (k >= layers or pz < slabs.low[k]):
        k -= 1
    while 0 <= k < layers:
        ta, tb = (slabs.low[k] - pz) / dz, (slabs.high[k] - pz) / dz
        ta, tb = max(0.0, min(ta, tb)), min(limit, max(ta, tb))
        if ta >= limit:
            break
        if tb >= ta:
            found = _hit_in_layer(slabs, k, px, py, dx, dy, ta, tb)
            if found < limit:
                return found
        k += step
    return limit
