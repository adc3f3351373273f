"""Route connections around obstacles: search a path on a lattice, smooth it to a spline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.geometry.polyline import arc_lengths, places_along
from design.vasculature.growth.kernels.index import CellIndex
from design.vasculature.loops.curves import (
    ConnectionLimits,
    Ends,
    polyline_cost,
    radius_for,
)
from design.vasculature.loops.route_search import NO_WAY, UNDECIDED, Lattice, search
from design.vasculature.loops.settings import ROUTE, SPLINE
from design.vasculature.loops.spline import relax, spline_points
from kernels.arrays import FloatArray


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
