"""Find where grid lines enter and leave a closed mesh.

The winding number of a point is the signed count of surface crossings on the way to it from
outside. Along grid lines it costs one crossing list per line, is exact (an integer) for any
closed, consistently oriented mesh, also with cavities, thin walls and nested shells.
"""

from __future__ import annotations

from math import ceil, floor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from kernels import jit, scalar_jit

# Lines pass beside vertices and edges that lie on round coordinates, by a hair of the spacing.
_SHIFTS = ((1.7320508e-5, 2.2360680e-5), (-3.1622777e-5, 2.6457513e-5), (4.1231056e-5, -3.6e-5))


class Columns(NamedTuple):
    """Crossings of lines along one axis.

    Attributes
    ----------
    start : (a * b + 1,) int64
        Crossings of line (j, k) are ``start[j * b + k]:start[j * b + k + 1]``.
    where : (c,) float64, mm
        Place along the axis, ascending in each line.
    turn : (c,) int8
        +1 where the line enters the solid, -1 where it leaves.
    face : (c,) int32
        Triangle crossed.
    shape : (2,) int64
        Lines (a, b) across.
    """

    start: NDArray[np.int64]
    where: NDArray[np.float64]
    turn: NDArray[np.int8]
    face: NDArray[np.int32]
    shape: NDArray[np.int64]


def cross_columns(
    corners: NDArray[np.float64],
    axis: int,
    origin: NDArray[np.float64],
    spacing_mm: float,
    shape: tuple[int, int],
) -> Columns:
    """Cross triangles with lines along ``axis``.

    Parameters
    ----------
    corners : (f, 3, 3) float64, mm
        Corners of each triangle, counter-clockwise seen from outside.
    axis : int
        0, 1 or 2; the lines are spread over the next two axes, cyclically.
    origin : (3,) float64, mm
        A point of line (0, 0).
    spacing_mm : float
        Between lines.
    shape : (int, int)
        How many lines.

    Raises
    ------
    TissueError
        When crossings of a line don't cancel: the mesh isn't closed or consistently oriented.
    """
    order = [axis, (axis + 1) % 3, (axis + 2) % 3]
    turned = np.ascontiguousarray(corners[:, :, order])
    size = np.array(shape, dtype=np.int64)
    for shift in _SHIFTS:
        base = origin[order[1:]] + np.array(shift) * spacing_mm
        start, where, turn, face = _cross(turned, base, spacing_mm, size)
        if _sort_lines(start, where, turn, face) == 0:
            return Columns(start, where, turn, face, size)
    raise TissueError(
        "surface crossings along a line don't cancel; the mesh has holes, or faces that look "
        "the wrong way: repair it and give a closed, outward-oriented mesh"
    )


@jit
def _side(av: float, aw: float, bv: float, bw: float, v: float, w: float) -> bool:
    """Whether (v, w) is left of the directed line a to b; neighbours agree on it exactly."""
    if (av > bv) or (av == bv and aw > bw):
        return not ((av - bv) * (w - bw) - (aw - bw) * (v - bv) >= 0.0)
    return bool((bv - av) * (w - aw) - (bw - aw) * (v - av) >= 0.0)


@scalar_jit
def crossing(c: Any, v: float, w: float) -> int:
    """Return +1 where a line going up enters through triangle ``c``, -1 where it leaves, else 0."""
    ab = _side(c[0, 1], c[0, 2], c[1, 1], c[1, 2], v, w)
    bc = _side(c[1, 1], c[1, 2], c[2, 1], c[2, 2], v, w)
    ca = _side(c[2, 1], c[2, 2], c[0, 1], c[0, 2], v, w)
    if ab and bc and ca:
        return -1
    if not (ab or bc or ca):
        return 1
    return 0


@scalar_jit
def crossing_place(c: Any, v: float, w: float) -> float:
    """Where the line (v, w) meets the triangle's plane, clipped to the triangle's extent."""
    abv, abw = c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    acv, acw = c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    area = abv * acw - abw * acv
    low = min(c[0, 0], min(c[1, 0], c[2, 0]))
    high = max(c[0, 0], max(c[1, 0], c[2, 0]))
    if area == 0.0:
        return 0.5 * (low + high)
    s = ((v - c[0, 1]) * acw - (w - c[0, 2]) * acv) / area
    t = (abv * (w - c[0, 2]) - abw * (v - c[0, 1])) / area
    return min(high, max(low, c[0, 0] + s * (c[1, 0] - c[0, 0]) + t * (c[2, 0] - c[0, 0])))


@jit
def _cross(corners: Any, base: Any, spacing: float, shape: Any) -> Any:
    start = np.zeros(shape[0] * shape[1] + 1, np.int64)
    where = np.zeros(0)
    turn = np.zeros(0, np.int8)
    face = np.zeros(0, np.int32)
    # Counted first, then written: the lists need no growing.
    for fill in range(2):
        if fill == 1:
            start[1:] = np.cumsum(start[1:])
            total = start[-1]
            where, turn = np.empty(total), np.empty(total, np.int8)
            face = np.empty(total, np.int32)
            begin = start.copy()
        for f in range(len(corners)):
            c = corners[f]
            v0 = min(c[0, 1], min(c[1, 1], c[2, 1]))
            v1 = max(c[0, 1], max(c[1, 1], c[2, 1]))
            w0 = min(c[0, 2], min(c[1, 2], c[2, 2]))
            w1 = max(c[0, 2], max(c[1, 2], c[2, 2]))
            j0 = max(0, ceil((v0 - base[0]) / spacing))
            j1 = min(shape[0] - 1, floor((v1 - base[0]) / spacing))
            k0 = max(0, ceil((w0 - base[1]) / spacing))
            k1 = min(shape[1] - 1, floor((w1 - base[1]) / spacing))
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    v, w = base[0] + j * spacing, base[1] + k * spacing
                    sign = crossing(c, v, w)
                    if sign == 0:
                        continue
                    line = j * shape[1] + k
                    if fill == 0:
                        start[line + 1] += 1
                    else:
                        at = begin[line]
                        where[at] = crossing_place(c, v, w)
                        turn[at] = sign
                        face[at] = f
                        begin[line] += 1
    return start, where, turn, face


@jit
def _sort_lines(start: Any, where: Any, turn: Any, face: Any) -> int:
    """Sort each line's crossings; return how many lines don't end outside."""
    bad = 0
    for line in range(len(start) - 1):
        total = 0
        for i in range(start[line], start[line + 1]):
            total += turn[i]
            x, s, f = where[i], turn[i], face[i]
            j = i - 1
            # Entering goes first where two faces touch: a shared point is inside.
            while j >= start[line] and (where[j] > x or (where[j] == x and turn[j] < s)):
                where[j + 1], turn[j + 1], face[j + 1] = where[j], turn[j], face[j]
                j -= 1
            where[j + 1], turn[j + 1], face[j + 1] = x, s, f
        bad += total != 0
    return bad
