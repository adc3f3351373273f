"""Route connections around obstacles: search a path on a lattice, smooth it to a spline."""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush
from math import acos
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths, places_along
from design.vasculature.growth.kernels.index import CellIndex
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


class RouteSettings(NamedTuple):
    """How ways round are searched on lattices, and smoothed."""

    lattices: tuple[tuple[float, float], ...] = ((16.0, 0.6), (10.0, 2.0), (32.0, 0.4), (24.0, 1.5))
    """Tried until one has a way: spacings to a chord, and margin around it in chords."""
    max_nodes: int = 600_000
    """Points of a lattice; a finer one is made coarser."""
    first_steps: int = 1_000
    max_steps: int = 40_000
    """Steps checked in a search for whether an end is walled in, and in the search proper."""
    length_factor: float = 1.5
    """Length of a route over its chord, assumed while it is searched."""
    join_spacings: float = 2.5
    """Lattice points within so many spacings of an end are joined to it directly."""
    min_turn_cosine: float = 0.5
    """Of the angle between two steps: sharper turns can't be smoothed."""
    legs: tuple[float, float, float] = (4.0, 8.0, 16.0)
    """Distances of a spline's control points that are tried, in radii."""
    max_legs: int = 64
    sweeps: tuple[int, int, int, int] = (0, 3, 8, 20)
    """Relaxations of a spline after each of which it is weighed."""


class SplineSampling(NamedTuple):
    """How a spline is checked, and becomes straight pieces."""

    pieces: int = 100
    """At most."""
    points_per_span: int = 8
    """Points of a span of which some become the polyline's."""
    max_turn: float = 0.35
    """Turn of a curve within a piece, radians."""
    max_length: float = 10.0
    """Length of a piece over its radius, unless there are too many."""
    checks_per_span: int = 4
    """Pieces of a span that are checked while relaxing."""
    widening: float = 1.15
    """Width over the connection's with which it is relaxed: pieces cut its bends."""
    narrowing: float = 8.0
    """Radii from an end within which that is given up: terminals are crowded."""


ROUTE, SPLINE = RouteSettings(), SplineSampling()


@dataclass(frozen=True)
class RouteObstacles:
    """Tissue, vessels and limits that a route keeps to.

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
    """A route's polyline (n + 1, 3) and radius, mm."""

    points: FloatArray
    radius: float


def find_route(ends: Ends, obstacles: RouteObstacles) -> Route | None:
    """Return the cheapest smoothed route between two ends, or None where none was found.

    Bends, kinks, clearance and containment are tested as of a Bézier curve, with the same cost.
    """
    for per_chord, margin in ROUTE.lattices:
        path = _path(ends, obstacles, per_chord, margin)
        best = None if path is None else _smoothed(path, ends, obstacles)
        if best is not None:
            return best
    return None


def _path(
    ends: Ends, obstacles: RouteObstacles, per_chord: float, margin: float
) -> FloatArray | None:
    """Return the shortest path over one lattice, (n, 3), or None."""
    chord = float(np.linalg.norm(ends.point[1] - ends.point[0]))
    radius = radius_for(ROUTE.length_factor * chord, ends, obstacles.limits)
    low = np.maximum(ends.point.min(axis=0) - margin * chord, obstacles.bounds[0])
    high = np.minimum(ends.point.max(axis=0) + margin * chord, obstacles.bounds[1])
    cell = max(chord / per_chord, 2.0 * radius)
    cell = max(cell, float(np.cbrt(np.prod(high - low) / ROUTE.max_nodes)))
    # The first end lies midway between lattice points: none coincides with it.
    low = ends.point[0] - cell * (np.floor((ends.point[0] - low) / cell) + 0.5)
    shape = np.maximum(np.floor((high - low) / cell), 0).astype(np.int64) + 1
    lattice = Lattice(low, shape, cell)
    path = np.empty((4 * int(shape.sum()) + 16, 3))
    # From the far end first, a little: where that is walled in, the other floods the lattice.
    for side, steps in ((1, ROUTE.first_steps), (0, ROUTE.max_steps)):
        count = search(
            swap_ends(ends) if side else ends,
            radius,
            lattice,
            obstacles.limits,
            obstacles.index,
            obstacles.capsules,
            steps,
            path,
        )
        if count == NO_WAY:
            return None
        if count != UNDECIDED:
            return np.ascontiguousarray(path[:count][::-1]) if side else path[:count]
    return None


def _smoothed(path: FloatArray, ends: Ends, obstacles: RouteObstacles) -> Route | None:
    """Return the cheapest spline along a path, or None where none fits."""
    limits, index, capsules = obstacles.limits, obstacles.index, obstacles.capsules
    arc = arc_lengths(path)
    radius = radius_for(float(arc[-1]), ends, limits)
    points = np.empty((SPLINE.pieces + 1, 3))
    best: Route | None = None
    least = np.inf
    for count in sorted({_legs(arc[-1] / (legs * radius)) for legs in ROUTE.legs}):
        # The first and last leg turn no more than allowed: they are the path's own.
        at = np.concatenate([[0.0], np.linspace(arc[1], arc[-2], count - 1), [arc[-1]]])
        control = places_along(path, arc, at)
        done = 0
        for sweeps in ROUTE.sweeps:
            relax(control, sweeps - done, ends, radius, limits, index, capsules)
            done = sweeps
            pieces, bend = spline_points(control, ends, limits, SPLINE.pieces, points)
            line = points[: pieces + 1]
            cost, spline_radius = polyline_cost(ends, line, bend, limits, index, capsules, least)
            if cost < least:
                best, least = Route(line.copy(), spline_radius), cost
    return best


def _legs(wanted: float) -> int:
    return int(np.clip(round(wanted), 4, ROUTE.max_legs))


def swap_ends(ends: Ends) -> Ends:
    """Return the same ends, the second one first."""
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
"""Results of a search that found no way: it saw all points, or its steps ran out."""
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


class Search(NamedTuple):
    """State of a search.

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
    """Write the coordinates of a lattice point, mm."""
    low, shape, cell = lattice
    out[2] = low[2] + cell * (node % shape[2])
    node = node // shape[2]
    out[1] = low[1] + cell * (node % shape[1])
    out[0] = low[0] + cell * (node // shape[1])


@jit
def search(
    ends: Ends,
    radius: float,
    lattice: Lattice,
    limits: ConnectionLimits,
    index: CellIndex,
    capsules: Any,
    most: int,
    path: Any,
) -> int:
    """Write the shortest clear path from end to end over a lattice of 26 neighbours; its length.

    A* (Hart, Nilsson & Raphael 1968, doi 10.1109/TSSC.1968.300136), distance to the far end as
    the heuristic. A step is checked only when it would be taken: checks cost far more than the
    heap. First and last steps keep within the limit on kinks.

    Parameters
    ----------
    radius : float, mm
        Of the vessel that is to follow the path.
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
        if not piece_clear(ends, here, there, start, left, radius, limits, index, capsules):
            continue
        if hairpin(ends, state.came, before, lattice, there):
            continue
        state.came[node], state.gone[node] = before, g
        if node == total:
            return trace(state.came, node, lattice, ends, path)
        if (
            left <= ROUTE.join_spacings * lattice.cell
            and heading(ends, 1, goal, there) >= limits.min_cosine
        ):
            heappush(heap, (g + left, g + left, total, node))
        push_onward(heap, state, node, there, ends, radius, lattice, limits, index, capsules)
    return NO_WAY


@jit
def push_onward(
    heap: Any,
    state: Search,
    node: int,
    place: Any,
    ends: Ends,
    radius: float,
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
                    free = piece_clear(
                        ends, there, there, far, left, radius, limits, index, capsules
                    )
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
    reach = int(ROUTE.join_spacings) + 1
    centre = np.empty(3, np.int64)
    for x in range(3):
        centre[x] = round((here[x] - low[x]) / cell)
    for i in range(max(0, centre[0] - reach), min(shape[0], centre[0] + reach + 1)):
        for j in range(max(0, centre[1] - reach), min(shape[1], centre[1] + reach + 1)):
            for k in range(max(0, centre[2] - reach), min(shape[2], centre[2] + reach + 1)):
                node = (i * shape[1] + j) * shape[2] + k
                node_place(node, lattice, there)
                far = point_distance(here, there)
                if far <= ROUTE.join_spacings * cell and heading(ends, 0, here, there) >= straight:
                    heappush(heap, (far + point_distance(there, goal), far, node, -1))


@jit
def hairpin(ends: Ends, came: Any, node: int, lattice: Lattice, onward: Any) -> bool:
    """Return whether a step from ``node`` to ``onward`` turns too sharply from the one before."""
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
    return dot < ROUTE.min_turn_cosine * point_distance(here, there) * point_distance(here, onward)


@jit
def trace(came: Any, node: int, lattice: Lattice, ends: Ends, path: Any) -> int:
    """Write the path that ends at the goal's ``node``; `NO_WAY` where ``path`` is too short."""
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


@jit
def span(control: Any, i: int, out: Any) -> None:
    """Write the Bézier control points (4, 3) of the B-spline's part between controls i and i + 1.

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

    A piece ends where the curve has turned by ``max_turn`` since it began, or gets too long; but
    it has the least length that separates the pieces before and after it (see `stations`).
    """
    dense = (len(control) - 1) * SPLINE.points_per_span + 1
    line, arc = np.empty((dense, 3)), np.zeros(dense)
    part = np.empty((4, 3))
    bend = np.inf
    line[0] = ends.point[0]
    for n in range(1, dense):
        i, m = divmod(n - 1, SPLINE.points_per_span)
        span(control, i, part)
        if m == 0:
            bend = min(bend, tightest_bend(part))
        bezier(part, (m + 1) / SPLINE.points_per_span, line[n])
        arc[n] = arc[n - 1] + point_distance(line[n - 1], line[n])
    length = arc[dense - 1]
    radius = radius_for(length, ends, limits)
    kept = max(limits.clearance, limits.ratio * radius)
    shortest = CURVE.separation * (radius + ends.radius[0] + kept)
    last = CURVE.separation * (radius + ends.radius[1] + kept)
    longest = max(1.5 * length / most, SPLINE.max_length * radius)
    count, begun, turn = 0, 0.0, 0.0
    points[0] = ends.point[0]
    for n in range(1, dense - 1):
        turn += turning(line[n - 1], line[n], line[n + 1])
        size = arc[n] - begun
        if length - arc[n] < last or count == most - 1:
            break
        if size >= shortest and (turn >= SPLINE.max_turn or size + arc[n + 1] - arc[n] > longest):
            count += 1
            points[count] = line[n]
            begun, turn = arc[n], 0.0
            shortest = CURVE.separation * (2.0 * radius + kept)
    count += 1
    points[count] = ends.point[1]
    return count, bend


@jit
def turning(a: Any, b: Any, c: Any) -> float:
    """Return the angle between the ways from a to b and from b to c, radians."""
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
    """Return whether spans ``first`` to ``last`` are in the tissue and clear of all vessels."""
    part = np.empty((4, 3))
    here, there = np.empty(3), np.empty(3)
    length = arc[len(control) - 1]
    for i in range(max(first, 0), min(last, len(control) - 2) + 1):
        span(control, i, part)
        here[:] = part[0]
        for n in range(SPLINE.checks_per_span):
            bezier(part, (n + 1) / SPLINE.checks_per_span, there)
            step = (arc[i + 1] - arc[i]) / SPLINE.checks_per_span
            gone = arc[i] + n * step
            left = length - gone - step
            ease = 1.0 + min(gone, left) / (SPLINE.narrowing * radius)
            wide = radius * min(SPLINE.widening, ease)
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
