"""Triangulate the rounded wall of one vessel junction by rays from its centre.

All vessels of a junction hold its point and are convex, so their union is star-shaped about it, and
so is its closing by a ball: each direction meets the surface once. Triangles of directions, drawn
out to the surface, are therefore closed, oriented and free of self-intersection whatever the
vessels are; what remains is to put directions where the surface bends.
"""

from __future__ import annotations

import numpy as np

from design.solids.smooth.fillet import shoot
from design.solids.smooth.star_net import CAP, Junction, Net, inserted, new_net
from design.solids.smooth.star_parts import refine_directions
from design.solids.smooth.star_start import cover_in, rings_in, seams_in, start_triangles
from kernels import jit
from kernels.arrays import FloatArray, IntArray

_ROUNDS = 12
"""Of parting triangles; each takes the error down about threefold."""


@jit
def star_mesh(
    walls: FloatArray,
    rho: float,
    reach: FloatArray,
    rings: FloatArray,
    ring_of: IntArray,
    tolerance: float,
    least: float,
    most: int,
) -> tuple[int, FloatArray, IntArray]:
    """Triangles of one junction between the first rings of its tubes.

    Parameters
    ----------
    walls : (n, 10) float64
    rho : float, mm
        Radius of the fillet; 0 for a sharp seam, which the triangles' edges then follow.
    reach : (n,) float64, mm
        Distance of each ring along its axis.
    rings : (r, 3) float64, mm
        Vertices of all rings; they come first among the points.
    ring_of : (r,) int64
        Which vessel's.
    tolerance : float, mm
        Greatest distance of a triangle's middle from the surface.
    least : float, mm
        Edges shorter than that aren't parted.
    most : int
        Points at most.

    Returns
    -------
    status : int
        0, or 1 where directions don't surround the middle, 2 where ``most`` isn't
        enough, 3 where rounding blurs the order of directions.
    points : (p, 3) float64, mm
        The rings' first.
    faces : (f, 3) int64
        Outward; their rim is the rings.
    """
    junction, net = Junction(walls, rho, reach, rings, ring_of, tolerance, least), new_net(most)
    first = len(rings)
    rings_in(junction, net)
    count = cover_in(junction, net)
    used = start_triangles(net, first, count)
    if used < 0:
        return -used, rings, net.tri[:0]
    shoot(walls, rho, net.d[first:count], net.away[first:count])
    count, used = seams_in(junction, net, count, used)
    status = 0
    for _ in range(_ROUNDS):
        if used < 0 or status:
            break
        begin = count
        count, full = refine_directions(junction, net, count, used)
        status = 2 if full else 0
        if count == begin:
            break
        shoot(walls, rho, net.d[begin:count], net.away[begin:count])
        used = inserted(net, begin, count, used)
    if used < 0:
        return 3, rings, net.tri[:0]
    points, faces = _without_caps(junction, net, count, used)
    return status, points, faces


@jit
def _without_caps(
    junction: Junction, net: Net, count: int, used: int
) -> tuple[FloatArray, IntArray]:
    """Places and faces of what isn't left out; the rings' places first, as they were given."""
    rings = junction.rings
    faces = np.empty((used, 3), dtype=np.int64)
    points = np.empty((count, 3))
    points[: len(rings)] = rings
    place_of = np.full(count, -1, dtype=np.int64)
    place_of[: len(rings)] = np.arange(len(rings))
    kept, placed = 0, len(rings)
    for t in range(used):
        if net.owner[net.tri[t]].min() == CAP:
            continue
        for k in range(3):
            p = net.tri[t, k]
            if place_of[p] < 0:
                place_of[p] = placed
                for axis in range(3):
                    points[placed, axis] = junction.walls[0, axis] + net.away[p] * net.d[p, axis]
                placed += 1
            faces[kept, k] = place_of[p]
        kept += 1
    return points[:placed], faces[:kept]
