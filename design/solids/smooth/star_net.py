"""Insert ray directions into a vessel junction's triangulation of them (compiled)."""

from __future__ import annotations

from math import sin, sqrt
from typing import NamedTuple

import numpy as np

from design.solids.smooth.sphere import insert
from kernels import jit
from kernels.arrays import FloatArray, IntArray

SEAM = -1
"""Owner of a point that lies on a seam, or on a fillet."""
CAP = -2
"""Owner of a vessel's axis, whose triangles are left out: there the tube goes on."""
_BLUR = 1e-7
"""Of directions in line; far below what moves a vertex by a float32 step."""


class Junction(NamedTuple):
    """A junction, as `star_mesh` takes it."""

    walls: FloatArray
    rho: float
    reach: FloatArray
    rings: FloatArray
    ring_of: IntArray
    tolerance: float
    least: float


class Net(NamedTuple):
    """Directions from the middle, and triangles between them.

    Attributes
    ----------
    d : (most, 3) float64
        Unit directions.
    away : (most,) float64, mm
        Distance of the surface.
    owner : (most,) int64
        Vessel, `SEAM` or `CAP`.
    tri, beside : (2 * most, 3) int64
        Corners of each triangle and its neighbours.
    stack : (4 * most,) int64
        Room for `insert`.
    settled : (2 * most, 4) int64
        Corners of each triangle, and their owners as one number, when it last needed no direction.
    """

    d: FloatArray
    away: FloatArray
    owner: IntArray
    tri: IntArray
    beside: IntArray
    stack: IntArray
    settled: IntArray


@jit
def new_net(most: int) -> Net:
    """Return room for `most` directions."""
    return Net(
        np.zeros((most, 3)),
        np.zeros(most),
        np.full(most, SEAM, dtype=np.int64),
        np.zeros((2 * most, 3), dtype=np.int64),
        np.zeros((2 * most, 3), dtype=np.int64),
        np.zeros(4 * most, dtype=np.int64),
        np.full((2 * most, 4), -1, dtype=np.int64),
    )


@jit
def unit(d: FloatArray) -> None:
    """Make a direction a unit vector, in place."""
    d /= sqrt(np.sum(d * d))


@jit
def blur(d: FloatArray, number: int) -> None:
    """Move a direction a little, in place.

    Symmetric junctions have rings in line with one another, of which rounding makes a muddle: for
    the order of directions (not for their places) they are a little off.
    """
    for axis in range(3):
        d[axis] += _BLUR * sin(12.9898 * number + 78.233 * axis + 1.0)
    unit(d)


@jit
def inserted(net: Net, begin: int, end: int, used: int) -> int:
    """Put directions into the triangles; return how many those are, below 0 where that fails."""
    for p in range(begin, end):
        used = insert(net.d, p, net.tri, net.beside, used, net.stack)
        if used < 0:
            break
    return used


@jit
def gap(net: Net, p: int, q: int) -> float:
    """Distance of two points of the surface, mm."""
    square = 0.0
    for axis in range(3):
        square += (net.away[p] * net.d[p, axis] - net.away[q] * net.d[q, axis]) ** 2
    return sqrt(square)
