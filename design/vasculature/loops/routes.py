"""Route connecting vessels around obstacles: lattice search, smoothing and cost."""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from math import acos
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths, places_along
from design.vasculature.growth.index import CellIndex
from design.vasculature.loops.curves import (
    CURVE,
    ConnectionLimits,
    Ends,
    bezier,
    heading,
    piece_clear,
    point_distance,
    polyline_cost,
    radius_for,
    tightest_bend,
)
from kernels import jit
from kernels.arrays import FloatArray

ROUTE_PIECES = 100
"""Straight pieces of a route at most."""
LATTICES = ((16.0, 0.6), (10.0, 2.0), (32.0, 0.4), (24.0, 1.5))
"""Lattices tried until one has a way: spacings to a chord, and room around it, in chords."""
STEPS_AT_MOST, FIRST_STEPS = 40_000, 1_000
"""Steps checked in one search, and in one that only looks whether an end is walled in."""
NODES_AT_MOST = 600_000
"""Points of a lattice; a finer one is made coarser."""
ROOM = (1.0, 1.6, 3.0)
"""Widths, over the connection's, for which a way is searched: wide ones keep more clear."""
LEGS = (4.0, 8.0, 16.0)
"""Distances of a spline's control points, in radii."""
SWEEPS = (0, 3, 8, 20)
"""Relaxations of a spline, each followed by a weighing."""
_LONGER = 1.5
"""Length of a route over its chord, at a guess, while it is searched."""
_MOST_LEGS = 64


@dataclass(frozen=True)
class RouteObstacles:
    """What a route has to keep clear of.

    Attributes
    ----------
    limits : ConnectionLimits
    index : CellIndex
    capsules : (k,) CAPSULE
    bounds : (2, 3) float64, mm
        Of the tissue.
    """

    limits: ConnectionLimits
    index: CellIndex
    capsules: NDArray[np.void]
    bounds: FloatArray


@dataclass(frozen=True)
class Route:
    """A route's polyline (n + 1, 3) and radius, mm, and what it costs."""

    points: FloatArray
    radius: float
    cost: float


def find_route(ends: Ends, crowd: RouteObstacles) -> Route | None:
    """The cheapest of several routes between two ends, or None where none was found.

    Each has bends, kinks, clearance and containment tested as a Bézier curve has, and the same
    cost.
    """
    best: Route | None = None
    for per_chord, margin in LATTICES:
        for room in ROOM:
            way = _way(ends, crowd, per_chord, margin, room)
            if way is None:
                # What is too narrow for this is for more.
                break
            best = _smoothed(way, ends, crowd, best)
        if best is not None:
            return best
    return best


def _way(
    ends: Ends, crowd: RouteObstacles, per_chord: float, margin: float, room: float
) -> FloatArray | None:
    """The shortest way over one lattice, (n, 3)."""
    chord = float(np.linalg.norm(ends.point[1] - ends.point[0]))
    radius = radius_for(_LONGER * chord, ends, crowd.limits)
    low = np.maximum(ends.point.min(axis=0) - margin * chord, crowd.bounds[0])
    high = np.minimum(ends.point.max(axis=0) + margin * chord, crowd.bounds[1])
    cell = max(chord / per_chord, 2.0 * radius)
    cell = max(cell, float(np.cbrt(np.prod(high - low) / NODES_AT_MOST)))
    # The first end lies midway between lattice points: none coincides with it.
    low = ends.point[0] - cell * (np.floor((ends.point[0] - low) / cell) + 0.5)
    shape = np.maximum(np.floor((high - low) / cell), 0).astype(np.int64) + 1
    lattice, width = Lattice(low, shape, cell), Width(radius, room)
    path = np.empty((4 * int(shape.sum()) + 16, 3))
    # From the far end first, a little: where that is walled in, the other floods the lattice.
    for side, steps in ((1, FIRST_STEPS), (0, STEPS_AT_MOST)):
        count = search(
            swap_ends(ends) if side else ends,
            width,
            lattice,
            crowd.limits,
            crowd.index,
            crowd.capsules,
            steps,
            path,
        )
        if count == NO_WAY:
            return None
        if count != UNDECIDED:
            return np.ascontiguousarray(path[:count][::-1]) if side else path[:count]
    return None


def _smoothed(
    way: FloatArray, ends: Ends, crowd: RouteObstacles, best: Route | None
) -> Route | None:
    """The cheapest spline along a way, where it is cheaper than the ``best`` so far."""
    arc = arc_lengths(way)
    radius = radius_for(float(arc[-1]), ends, crowd.limits)
    points = np.empty((ROUTE_PIECES + 1, 3))
    for count in sorted({_legs(arc[-1] / (legs * radius)) for legs in LEGS}):
        # The first and last leg turn no more than allowed: they are the way's own.
        at = np.concatenate([[0.0], np.linspace(arc[1], arc[-2], count - 1), [arc[-1]]])
        control = places_along(way, arc, at)
        done = 0
        for sweeps in SWEEPS:
            relax(control, sweeps - done, ends, radius, crowd.limits, crowd.index, crowd.capsules)
            done = sweeps
            pieces, bend = spline_points(control, ends, crowd.limits, ROUTE_PIECES, points)
            line = points[: pieces + 1]
            most = best.cost if best else np.inf
            cost, spline = polyline_cost(
                ends, line, bend, crowd.limits, crowd.index, crowd.capsules, most
            )
            if cost < most:
                best = Route(line.copy(), spline, cost)
    return best


def _legs(wanted: float) -> int:
    return int(np.clip(round(wanted), 4, _MOST_LEGS))


def swap_ends(ends: Ends) -> Ends:
    """The same ends, the second one first."""
    return Ends(
        np.ascontiguousarray(ends.point[::-1]),
        np.ascontiguousarray(ends.direction[::-1]),
        np.ascontiguousarray(ends.radius[::-1]),
        np.ascontiguousarray(ends.kin[::-1]),
        np.ascontiguousarray(ends.way[::-1]),
        ends.lost,
    )


# Search the shortest collision-free route between two terminals on a lattice, by A*.

NO_WAY, UNDECIDED = 0, -1
"""What a search says that found none: it saw all there is, or its steps ran out."""
_NEAR = 2.5
"""Lattice points within this many spacings of an end are joined to it directly."""
_TURN = 0.5
"""Cosine of the sharpest turn between two steps: sharper ones can't be smoothed."""
_EASE = 8.0
"""Radii from an end within which the extra width is given up: terminals are crowded."""
UNSEEN, FREE, TAKEN = 0, 1, 2
"""What is known of a lattice point: nothing, or whether a vessel has room there."""


class Lattice(NamedTuple):
    """Points that a way may pass through, numbered along the last axis first.

    Attributes
    ----------
    low : (3,) float64, mm
        Point (0, 0, 0).
    shape : (3,) int64
    cell : float, mm
    """

    low: FloatArray
    shape: NDArray[np.int64]
    cell: float


class Width(NamedTuple):
    """How wide a way must be.

    Attributes
    ----------
    radius : float, mm
        Of the vessel that is to go it.
    inflate : float
        Room kept, as a multiple of it.
    """

    radius: float
    inflate: float


class Search(NamedTuple):
    """What a search has found so far.

    Attributes
    ----------
    gone : (n + 1,) float64, mm
        Way from the first end to each lattice point, and to the far end.
    came : (n + 1,) int64
        The point before on that way; -1 for the first end, -2 where none is known.
    state : (n,) int8
        `UNSEEN`, `FREE` or `TAKEN`.
    """

    gone: FloatArray
    came: NDArray[np.int64]
    state: NDArray[np.int8]


@jit
def node_place(node: int, lattice: Lattice, out: Any) -> None:
    """Coordinates of a lattice point, mm."""
    low, shape, cell = lattice
    out[2] = low[2] + cell * (node % shape[2])
    node = node // shape[2]
    out[1] = low[1] + cell * (node % shape[1])
    out[0] = low[0] + cell * (node // shape[1])


@jit
def wide_at(radius: float, inflate: float, gone: float, left: float) -> float:
    """Radius with which a step is checked: ``inflate`` times as wide away from both ends."""
    return radius * min(inflate, 1.0 + min(gone, left) / (_EASE * radius))


@jit
def search(
    ends: Ends,
    width: Width,
    lattice: Lattice,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
    most: int,
    path: Any,
) -> int:
    """Shortest clear way from end to end over a lattice with 26 neighbours to each point.

    A* (Hart, Nilsson & Raphael 1968, doi 10.1109/TSSC.1968.300136), distance to the far end as
    the heuristic. A step is checked only when it would be taken: checks cost far more than the
    heap. First and last steps keep within the limit on kinks.

    Parameters
    ----------
    width : Width
    lattice : Lattice
    most : int
        Steps checked at most.
    path : (k, 3) float64, mm
        Receives the way, ends included.

    Returns
    -------
    int
        Points of the way; `NO_WAY`, or `UNDECIDED` after ``most`` steps.
    """
    total = lattice.shape[0] * lattice.shape[1] * lattice.shape[2]
    state = Search(
        np.full(total + 1, np.inf), np.full(total + 1, -2, np.int64), np.zeros(total, np.int8)
    )
    here, there = np.empty(3), np.empty(3)
    goal = ends.point[1]
    # Typed by an entry that is taken out again.
    heap = [(0.0, 0.0, -1, -1)]
    heap.pop()
    push_first(heap, ends, limits.min_cosine, lattice)
    steps = 0
    while len(heap) > 0:
        _, g, node, before = heappop(heap)
        if state.came[node] != -2:
            continue
        steps += 1
        if steps > most:
            return UNDECIDED
        if before < 0:
            here[:] = ends.point[0]
        else:
            node_place(before, lattice, here)
        if node == total:
            there[:] = goal
        else:
            node_place(node, lattice, there)
        start = state.gone[before] if before >= 0 else 0.0
        left = point_distance(there, goal)
        wide = wide_at(
            width.radius, width.inflate, min(start, g), min(left, point_distance(here, goal))
        )
        if not piece_clear(ends, here, there, start, left, wide, limits, index, capsules):
            continue
        if hairpin(ends, state.came, before, lattice, there):
            continue
        state.came[node], state.gone[node] = before, g
        if node == total:
            return trace(state.came, node, lattice, ends, path)
        if left <= _NEAR * lattice.cell and heading(ends, 1, goal, there) >= limits.min_cosine:
            heappush(heap, (g + left, g + left, total, node))
        push_onward(heap, state, node, there, ends, width, lattice, limits, index, capsules)
    return NO_WAY


@jit
def push_onward(
    heap: Any,
    state: Search,
    node: int,
    place: Any,
    ends: Ends,
    width: Width,
    lattice: Lattice,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> None:
    """Push the steps from ``node`` at ``place`` to those of its 26 neighbours that have room."""
    goal, g = ends.point[1], state.gone[node]
    there = np.empty(3)
    shape = lattice.shape
    c = node % shape[2]
    b = (node // shape[2]) % shape[1]
    a = node // (shape[1] * shape[2])
    for i in range(max(0, a - 1), min(shape[0], a + 2)):
        for j in range(max(0, b - 1), min(shape[1], b + 2)):
            for k in range(max(0, c - 1), min(shape[2], c + 2)):
                other = (i * shape[1] + j) * shape[2] + k
                if state.came[other] != -2 or state.state[other] == TAKEN:
                    continue
                node_place(other, lattice, there)
                left = point_distance(there, goal)
                far = g + point_distance(there, place)
                if state.state[other] == UNSEEN:
                    wide = wide_at(width.radius, width.inflate, far, left)
                    free = piece_clear(ends, there, there, far, left, wide, limits, index, capsules)
                    state.state[other] = FREE if free else TAKEN
                    if not free:
                        continue
                heappush(heap, (far + left, far, other, node))


@jit
def push_first(heap: Any, ends: Ends, straight: float, lattice: Lattice) -> None:
    """Push the steps from the first end to the lattice points near it, within the kink."""
    low, shape, cell = lattice
    here, goal = ends.point[0], ends.point[1]
    there = np.empty(3)
    reach = int(_NEAR) + 1
    centre = np.empty(3, np.int64)
    for x in range(3):
        centre[x] = round((here[x] - low[x]) / cell)
    for i in range(max(0, centre[0] - reach), min(shape[0], centre[0] + reach + 1)):
        for j in range(max(0, centre[1] - reach), min(shape[1], centre[1] + reach + 1)):
            for k in range(max(0, centre[2] - reach), min(shape[2], centre[2] + reach + 1)):
                node = (i * shape[1] + j) * shape[2] + k
                node_place(node, lattice, there)
                far = point_distance(here, there)
                if far <= _NEAR * cell and heading(ends, 0, here, there) >= straight:
                    heappush(heap, (far + point_distance(there, goal), far, node, -1))


@jit
def hairpin(ends: Ends, came: Any, node: int, lattice: Lattice, onward: Any) -> bool:
    """Whether a step from ``node`` to ``onward`` turns too sharply from the one before."""
    if node < 0:
        return False
    here, there = np.empty(3), np.empty(3)
    node_place(node, lattice, here)
    if came[node] < 0:
        there[:] = ends.point[0]
    else:
        node_place(came[node], lattice, there)
    dot = 0.0
    for x in range(3):
        dot += (here[x] - there[x]) * (onward[x] - here[x])
    return dot < _TURN * point_distance(here, there) * point_distance(here, onward)


@jit
def trace(came: Any, node: int, lattice: Lattice, ends: Ends, path: Any) -> int:
    """Write the way that ends at the goal's ``node``; `NO_WAY` where it has no room."""
    count, at = 2, came[node]
    while at >= 0:
        count += 1
        at = came[at]
    if count > len(path):
        return NO_WAY
    path[0], path[count - 1] = ends.point[0], ends.point[1]
    at = came[node]
    for n in range(count - 2, 0, -1):
        node_place(at, lattice, path[n])
        at = came[at]
    return count


# Smooth a route to a cubic B-spline, relaxed as far as clearances allow (compiled).

_PER_SPAN = 8
"""Points of a span of which some become the polyline's."""
_PIECE_TURN = 0.35
"""By how much a curve turns within a piece, radians."""
_LONGEST = 10.0
"""Length of a straight piece over its radius, unless there are too many."""
_SPARE = 1.15
"""Width, over the connection's, with which a spline is relaxed: pieces cut its bends."""
_CHECKED = 4
"""Pieces of a span that are checked while relaxing."""


@jit
def span(control: Any, i: int, out: Any) -> None:
    """Bézier control points (4, 3) of the B-spline's part between controls i and i + 1.

    Beyond an end the controls go on as mirrored at it, so that the curve passes through its ends
    along the first and last leg without curvature.
    """
    last = len(control) - 1
    for x in range(3):
        q, r = control[i, x], control[i + 1, x]
        p = control[i - 1, x] if i > 0 else 2.0 * q - r
        s = control[i + 2, x] if i + 1 < last else 2.0 * r - q
        out[0, x] = (p + 4.0 * q + r) / 6.0
        out[1, x] = (2.0 * q + r) / 3.0
        out[2, x] = (q + 2.0 * r) / 3.0
        out[3, x] = (q + 4.0 * r + s) / 6.0


@jit
def spline_points(
    control: Any, ends: Ends, limits: ConnectionLimits, most: int, points: Any
) -> tuple[int, float]:
    """Write a spline's polyline; return its pieces, at most ``most``, and least bend, mm.

    A piece ends where the curve has turned by `_TURN` since it began, or gets too long; but it
    has the least length that keeps the pieces before and after it apart (see `stations`).
    """
    dense = (len(control) - 1) * _PER_SPAN + 1
    line, arc = np.empty((dense, 3)), np.zeros(dense)
    part = np.empty((4, 3))
    bend = np.inf
    line[0] = ends.point[0]
    for n in range(1, dense):
        i, m = divmod(n - 1, _PER_SPAN)
        span(control, i, part)
        if m == 0:
            bend = min(bend, tightest_bend(part))
        bezier(part, (m + 1) / _PER_SPAN, line[n])
        arc[n] = arc[n - 1] + point_distance(line[n - 1], line[n])
    length = arc[dense - 1]
    radius = radius_for(length, ends, limits)
    kept = max(limits.clearance, limits.ratio * radius)
    shortest = CURVE.separation * (radius + ends.radius[0] + kept)
    last = CURVE.separation * (radius + ends.radius[1] + kept)
    longest = max(1.5 * length / most, _LONGEST * radius)
    count, begun, turn = 0, 0.0, 0.0
    points[0] = ends.point[0]
    for n in range(1, dense - 1):
        turn += turning(line[n - 1], line[n], line[n + 1])
        size = arc[n] - begun
        if length - arc[n] < last or count == most - 1:
            break
        if size >= shortest and (turn >= _PIECE_TURN or size + arc[n + 1] - arc[n] > longest):
            count += 1
            points[count] = line[n]
            begun, turn = arc[n], 0.0
            shortest = CURVE.separation * (2.0 * radius + kept)
    count += 1
    points[count] = ends.point[1]
    return count, bend


@jit
def turning(a: Any, b: Any, c: Any) -> float:
    """Angle between the ways from a to b and from b to c, radians."""
    dot = 0.0
    for x in range(3):
        dot += (b[x] - a[x]) * (c[x] - b[x])
    return acos(max(-1.0, min(1.0, dot / max(point_distance(a, b) * point_distance(b, c), 1e-300))))


@jit
def spans_clear(
    control: Any,
    first: int,
    last: int,
    arc: Any,
    ends: Ends,
    radius: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> bool:
    """Whether spans ``first`` to ``last`` are in the tissue and clear of all vessels."""
    part = np.empty((4, 3))
    here, there = np.empty(3), np.empty(3)
    length = arc[len(control) - 1]
    for i in range(max(first, 0), min(last, len(control) - 2) + 1):
        span(control, i, part)
        here[:] = part[0]
        for n in range(_CHECKED):
            bezier(part, (n + 1) / _CHECKED, there)
            step = (arc[i + 1] - arc[i]) / _CHECKED
            gone = arc[i] + n * step
            left = length - gone - step
            wide = wide_at(radius, _SPARE, gone, left)
            if not piece_clear(ends, here, there, gone, left, wide, limits, index, capsules):
                return False
            here[:] = there
    return True


@jit
def relax(
    control: Any,
    sweeps: int,
    ends: Ends,
    radius: float,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
) -> None:
    """Draw each inner control towards its neighbours' middle, as far as its spans stay clear."""
    last = len(control) - 1
    arc = np.zeros(last + 1)
    kept = np.empty(3)
    for _ in range(sweeps):
        for n in range(last):
            arc[n + 1] = arc[n] + point_distance(control[n], control[n + 1])
        for i in range(1, last):
            kept[:] = control[i]
            for part in (0.8, 0.3):
                for x in range(3):
                    middle = 0.5 * (control[i - 1, x] + control[i + 1, x])
                    control[i, x] = kept[x] + part * (middle - kept[x])
                turned = (
                    i == 1 and heading(ends, 0, control[0], control[1]) < limits.min_cosine
                ) or (
                    i == last - 1
                    and heading(ends, 1, control[last], control[last - 1]) < limits.min_cosine
                )
                if not turned and spans_clear(
                    control, i - 2, i + 1, arc, ends, radius, limits, index, capsules
                ):
                    break
                control[i] = kept
