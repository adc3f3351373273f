"""Route connecting vessels around obstacles: lattice search, smoothing and cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths, places_along
from design.vasculature.growth.index import CellIndex
from design.vasculature.loops.curve_fit import Ends, Rule, radius_for, weigh
from design.vasculature.loops.route_search import NO_WAY, UNDECIDED, Lattice, Width, search
from design.vasculature.loops.spline import relax, spline_points
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
    rule : Rule
    index : CellIndex
    capsules : (k,) CAPSULE
    bounds : (2, 3) float64, mm
        Of the tissue.
    """

    rule: Rule
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
    radius = radius_for(_LONGER * chord, ends, crowd.rule)
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
            crowd.rule,
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
    radius = radius_for(float(arc[-1]), ends, crowd.rule)
    points = np.empty((ROUTE_PIECES + 1, 3))
    for count in sorted({_legs(arc[-1] / (legs * radius)) for legs in LEGS}):
        # The first and last leg turn no more than allowed: they are the way's own.
        at = np.concatenate([[0.0], np.linspace(arc[1], arc[-2], count - 1), [arc[-1]]])
        control = places_along(way, arc, at)
        done = 0
        for sweeps in SWEEPS:
            relax(control, sweeps - done, ends, radius, crowd.rule, crowd.index, crowd.capsules)
            done = sweeps
            pieces, bend = spline_points(control, ends, crowd.rule, ROUTE_PIECES, points)
            line = points[: pieces + 1]
            until, most = len(crowd.capsules), best.cost if best else np.inf
            cost, spline = weigh(
                ends, line, bend, crowd.rule, crowd.index, crowd.capsules, until, most
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
