"""Choose the cheapest Bézier curve between two terminals, clear of all other vessels."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry import segment_segment
from design.tissue.grid import GridArrays, depth_along
from design.vasculature.growth.kernels.index import CellIndex, cell_range
from kernels import jit
from kernels.arrays import FloatArray


class CurveSampling(NamedTuple):
    """How a Bézier curve becomes straight pieces."""

    pieces: int = 10
    """At most."""
    min_pieces: int = 4
    """Where there is room for so many separate ones, or for none at all."""
    separation: float = 1.03
    """Length of a piece over what keeps the pieces before and after it apart."""
    bend_steps: int = 24
    """Steps along the curve at which its bend is measured."""
    length_steps: int = 20
    """Steps by which lengths along it are measured."""


CURVE = CurveSampling()


@jit
def bezier(control: Any, t: float, out: Any) -> None:
    """Write the point of a cubic Bézier curve with control points (4, 3) at ``t``."""
    s = 1.0 - t
    a, b, c, d = s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t
    for x in range(3):
        out[x] = a * control[0, x] + b * control[1, x] + c * control[2, x] + d * control[3, x]


@jit
def tightest_bend(control: Any) -> float:
    """Return the least radius of curvature |B'|³ / |B' x B''| at evenly spaced places, mm."""
    least = np.inf
    one, two = np.empty(3), np.empty(3)
    for n in range(CURVE.bend_steps + 1):
        t = n / CURVE.bend_steps
        s = 1.0 - t
        for x in range(3):
            p, q = control[1, x] - control[0, x], control[2, x] - control[1, x]
            r = control[3, x] - control[2, x]
            one[x] = 3.0 * (s * s * p + 2.0 * s * t * q + t * t * r)
            two[x] = 6.0 * (s * (q - p) + t * (r - q))
        speed = sqrt(one[0] ** 2 + one[1] ** 2 + one[2] ** 2)
        across = sqrt(
            (one[1] * two[2] - one[2] * two[1]) ** 2
            + (one[2] * two[0] - one[0] * two[2]) ** 2
            + (one[0] * two[1] - one[1] * two[0]) ** 2
        )
        if across > 1e-12 * speed**3:
            least = min(least, speed**3 / across)
    return least


@jit
def handle(ends: Ends, side: int, shape: Any, control: Any) -> float:
    """Set the inner control point next to one end; return the cosine of the kink there.

    ``shape`` (4,): reach over the chord, lean towards the other end (0 to 1), and two sideways
    parts, all along or across the terminal's direction.
    """
    here, there = ends.point[side], ends.point[1 - side]
    u = ends.direction[side]
    chord = max(point_distance(here, there), 1e-9)
    # Two directions across u, from the axis least along it.
    axis = 0
    for x in range(1, 3):
        if abs(u[x]) < abs(u[axis]):
            axis = x
    j, k = (axis + 1) % 3, (axis + 2) % 3
    first = np.zeros(3)
    size = sqrt(u[j] ** 2 + u[k] ** 2)
    first[j], first[k] = -u[k] / size, u[j] / size
    v = np.empty(3)
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        second = u[y] * first[z] - u[z] * first[y]
        lean = (there[x] - here[x]) / chord
        v[x] = (1.0 - shape[1]) * u[x] + shape[1] * lean + shape[2] * first[x] + shape[3] * second
    size = max(sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2), 1e-9)
    cosine = 0.0
    for x in range(3):
        control[1 + side, x] = here[x] + shape[0] * chord * v[x] / size
        cosine += u[x] * v[x] / size
    return cosine


@jit
def curve_cost(
    ends: Ends,
    shape: Any,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
    best: float,
    points: Any,
) -> tuple[float, float, int]:
    """Return cost, radius (mm) and pieces of a candidate; inf where it doesn't fit.

    ``shape`` (8,) has `handle`'s four numbers for either end; ``points`` (pieces + 1, 3) receives
    the polyline. ``best`` as in `polyline_cost`.
    """
    control = np.empty((4, 3))
    control[0], control[3] = ends.point[0], ends.point[1]
    for side in range(2):
        if handle(ends, side, shape[4 * side : 4 * side + 4], control) < limits.min_cosine:
            return np.inf, 0.0, 0
    arc = np.zeros(CURVE.length_steps + 1)
    here, there = np.empty(3), np.empty(3)
    here[:] = control[0]
    for n in range(1, CURVE.length_steps + 1):
        bezier(control, n / CURVE.length_steps, there)
        arc[n] = arc[n - 1] + point_distance(here, there)
        here[:] = there
    length = arc[CURVE.length_steps]
    if limits.by_length * length / limits.length >= best:
        return np.inf, 0.0, 0
    bend = tightest_bend(control)
    if bend < 0.99 * limits.bend_to_radius * radius_for(length, ends, limits):
        return np.inf, 0.0, 0
    at = np.empty(CURVE.pieces + 1)
    count = stations(length, ends, limits, CURVE.pieces, at)
    m = 0
    for n in range(1, count):
        while arc[m + 1] < at[n]:
            m += 1
        t = (m + (at[n] - arc[m]) / (arc[m + 1] - arc[m])) / CURVE.length_steps
        bezier(control, t, points[n])
    # The ends exactly: pieces that share a node meet there to the last bit.
    points[0], points[count] = ends.point[0], ends.point[1]
    cost, radius = polyline_cost(ends, points[: count + 1], bend, limits, index, capsules, best)
    return cost, radius, count


@jit
def best_curve(
    ends: Ends,
    shapes: Any,
    first: int,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
    points: Any,
) -> tuple[float, int]:
    """Return radius (mm) and pieces of the cheapest of ``shapes`` (m, 8); 0 where none fits.

    All of the ``first`` shapes are weighed; where none fits, the others as far as the first
    that does. ``points`` (CURVE.pieces + 1, 3) receives its polyline.
    """
    best, best_radius, pieces = np.inf, 0.0, 0
    trial = np.empty((CURVE.pieces + 1, 3))
    for n in range(len(shapes)):
        if n >= first and best_radius > 0.0:
            break
        cost, radius, count = curve_cost(ends, shapes[n], limits, index, capsules, best, trial)
        if cost < best:
            best, best_radius, pieces = cost, radius, count
            points[:] = trial
    return best_radius, pieces


KIN = 10
"""Vessels behind an end that may be near without colliding: a terminal itself, its parent,
sibling, grandparent and aunt; or what is around a mixing node."""
CAPSULE = np.dtype(
    [
        ("px", "f8"),
        ("py", "f8"),
        ("pz", "f8"),
        ("dx", "f8"),
        ("dy", "f8"),
        ("dz", "f8"),
        ("radius", "f8"),
        ("present", "i8"),
    ]
)
"""A straight piece of a vessel: ends p and d, radius (mm), and whether it is present (1) or was
removed (0)."""


class ConnectionLimits(NamedTuple):
    """Limits on connections and weights of their cost, as kernels take them.

    Attributes
    ----------
    grid : GridArrays
    wall : float, mm
        Kept between lumen and the tissue's surface.
    clearance, ratio : float
        Kept between vessels: the larger of mm and a part of the thinner radius.
    radius, length : float, mm
        A curve of this length has this radius; others the same resistance, r⁴ ~ length.
    min_radius : float, mm
    bend_to_radius : float
        Least bend radius over lumen radius.
    min_cosine : float
        Of the angle between a terminal and the curve that continues it.
    ample_gap : float
        Gap over the radius beyond which a larger one costs no less.
    by_length, by_tortuosity, by_clearance, by_volume : float
        Weights of the cost.
    """

    grid: GridArrays
    wall: float
    clearance: float
    ratio: float
    radius: float
    length: float
    min_radius: float
    bend_to_radius: float
    min_cosine: float
    ample_gap: float
    by_length: float
    by_tortuosity: float
    by_clearance: float
    by_volume: float


class Ends(NamedTuple):
    """Two ends that a curve joins.

    Attributes
    ----------
    point, direction : (2, 3) float64
        Tips, mm, and unit vectors in which their vessels point there.
    radius : (2,) float64, mm
        Of the vessels there.
    kin : (2, KIN) int64
        Capsules behind each tip, -1 for none.
    way : (2, KIN) float64, mm
        Along the vessels from the tip to each.
    lost : float, mm⁻³
        Length over r⁴ that the terminals lost when they were shortened; the curve makes up for
        it, so that all three together keep their resistance.
    """

    point: FloatArray
    direction: FloatArray
    radius: FloatArray
    kin: NDArray[np.int64]
    way: FloatArray
    lost: float


@jit
def point_distance(a: Any, b: Any) -> float:
    """Return the distance of two points."""
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@jit
def radius_for(length: float, ends: Ends, limits: ConnectionLimits) -> float:
    """Return the radius that gives a curve of ``length`` the resistance all have, mm."""
    return sqrt(sqrt(length / (limits.length / limits.radius**4 + ends.lost)))


@jit
def stations(length: float, ends: Ends, limits: ConnectionLimits, most: int, at: Any) -> int:
    """Set positions of a curve's points along it, mm, for at most ``most`` pieces; return these.

    Pieces are long enough that those before and after one don't come near each other: they would
    count as overlapping within their joint. Curves too short for ``min_pieces`` of them have three
    or two; those too short for two have ``min_pieces`` again, for the sake of their shape.
    """
    radius = radius_for(length, ends, limits)
    kept = max(limits.clearance, limits.ratio * radius)
    inner = CURVE.separation * (2.0 * radius + kept)
    first = CURVE.separation * (radius + ends.radius[0] + kept)
    last = CURVE.separation * (radius + ends.radius[1] + kept)
    at[0] = 0.0
    if first + last > length:
        for n in range(1, CURVE.min_pieces + 1):
            at[n] = length * n / CURVE.min_pieces
        return CURVE.min_pieces
    count = min(most, 2 + int((length - first - last) / inner))
    spare = (length - first - last - (count - 2) * inner) / count
    for n in range(1, count):
        at[n] = first + spare + (n - 1) * (inner + spare)
    at[count] = length
    return count


@jit
def polyline_cost(
    ends: Ends,
    points: Any,
    bend: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
    best: float,
) -> tuple[float, float]:
    """Return cost and radius (mm) of a polyline; inf where it doesn't fit or costs ``best``.

    Parameters
    ----------
    points : (n + 1, 3) float64, mm
    bend : float, mm
        Least bend radius of the curve that the points are on.
    """
    count = len(points) - 1
    arc = np.zeros(count + 1)
    for n in range(count):
        arc[n + 1] = arc[n] + point_distance(points[n], points[n + 1])
    length = arc[count]
    chord = max(point_distance(points[0], points[count]), 1e-9)
    radius = radius_for(length, ends, limits)
    if radius < limits.min_radius:
        return np.inf, 0.0
    volume = length * radius**2 / (limits.length * limits.radius**2)
    cost = limits.by_length * length / limits.length + limits.by_tortuosity * (length / chord - 1.0)
    cost += limits.by_volume * volume
    if (
        cost >= best
        or bend < limits.bend_to_radius * radius
        or kink(ends, points) < limits.min_cosine
    ):
        return np.inf, 0.0
    need = radius + limits.wall
    for n in range(count):
        p, q = points[n], points[n + 1]
        if depth_along(limits.grid, p[0], p[1], p[2], q[0], q[1], q[2], need) < need:
            return np.inf, 0.0
    if meets_itself(points, arc, radius, limits):
        return np.inf, 0.0
    gap = limits.ample_gap * radius
    for n in range(count):
        gap = piece_gap(
            ends, points[n], points[n + 1], arc[n], length - arc[n + 1],
            radius, gap, limits, index, capsules,
        )  # fmt: skip
        if gap < 0.0:
            return np.inf, 0.0
    cost += limits.by_clearance * max(0.0, 1.0 - gap / (limits.ample_gap * radius))
    return (cost if cost < best else np.inf), radius


@jit
def kink(ends: Ends, points: Any) -> float:
    """Return the cosine of the larger angle of a terminal and the polyline's piece there."""
    last = len(points) - 1
    return min(
        heading(ends, 0, points[0], points[1]), heading(ends, 1, points[last], points[last - 1])
    )


@jit
def heading(ends: Ends, side: int, here: Any, there: Any) -> float:
    """Return the cosine of the angle between an end's direction and the way from here to there."""
    dot = 0.0
    for x in range(3):
        dot += (there[x] - here[x]) * ends.direction[side, x]
    return dot / max(point_distance(here, there), 1e-12)


@jit
def meets_itself(points: Any, arc: Any, radius: float, limits: ConnectionLimits) -> bool:
    """Return whether two pieces of a curve come near that are far along it."""
    kept = max(limits.clearance, limits.ratio * radius)
    count = len(points) - 1
    for i in range(count):
        a, b = points[i], points[i + 1]
        for j in range(i + 2, count):
            if arc[j] - arc[i + 1] <= 4.0 * radius + kept:
                continue
            p, q = points[j], points[j + 1]
            d, _, _ = segment_segment(
                a[0], a[1], a[2], b[0], b[1], b[2], p[0], p[1], p[2], q[0], q[1], q[2]
            )
            if d < 2.0 * radius + kept:
                return True
    return False


@jit
def piece_gap(
    ends: Ends,
    a: Any,
    b: Any,
    to_first: float,
    to_second: float,
    radius: float,
    least: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> float:
    """Return the least gap between a piece's wall and any other vessel's where below ``least``, mm.

    -1 where they collide. What is near along the vessels belongs to the joint, by the rule of
    `design.vasculature.collide`; ``to_first`` and ``to_second`` are the ways along the
    curve from the piece to its ends.
    """
    reach = radius + max(limits.clearance, max(least, limits.ratio * radius))
    index.query[0] += 1
    query = index.query[0]
    i0, i1 = cell_range(index, 0, min(a[0], b[0]) - reach, max(a[0], b[0]) + reach)
    j0, j1 = cell_range(index, 1, min(a[1], b[1]) - reach, max(a[1], b[1]) + reach)
    k0, k1 = cell_range(index, 2, min(a[2], b[2]) - reach, max(a[2], b[2]) + reach)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            for k in range(k0, k1 + 1):
                entry = index.head[(i * index.shape[1] + j) * index.shape[2] + k]
                while entry >= 0:
                    item = index.item[entry]
                    entry = index.following[entry]
                    if index.stamp[item] == query:
                        continue
                    index.stamp[item] = query
                    s = capsules[item]
                    if s.present == 0:
                        continue
                    d, _, _ = segment_segment(
                        a[0], a[1], a[2], b[0], b[1], b[2],
                        s.px, s.py, s.pz, s.dx, s.dy, s.dz,
                    )  # fmt: skip
                    gap = d - radius - s.radius
                    kept = max(limits.clearance, limits.ratio * min(radius, s.radius))
                    if gap >= max(least, kept):
                        continue
                    limit = 2.0 * (radius + s.radius) + kept
                    if path_length(ends, item, to_first, to_second) <= limit:
                        continue
                    if gap < kept:
                        return -1.0
                    least = min(least, gap)
    return least


@jit
def path_length(ends: Ends, item: int, to_first: float, to_second: float) -> float:
    """Return the path length along the vessels from a piece to a capsule behind an end, mm."""
    way = np.inf
    for n in range(KIN):
        if ends.kin[0, n] == item:
            way = min(way, ends.way[0, n] + to_first)
        if ends.kin[1, n] == item:
            way = min(way, ends.way[1, n] + to_second)
    return way


@jit
def piece_clear(
    ends: Ends,
    a: Any,
    b: Any,
    to_first: float,
    to_second: float,
    radius: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> bool:
    """Return whether a piece is in the tissue and clear of all vessels."""
    need = radius + limits.wall
    if depth_along(limits.grid, a[0], a[1], a[2], b[0], b[1], b[2], need) < need:
        return False
    gap = piece_gap(ends, a, b, to_first, to_second, radius, 0.0, limits, index, capsules)
    return gap >= 0.0
