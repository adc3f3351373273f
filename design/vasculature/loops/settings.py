"""Settings of the route search and of the splines that smooth its routes."""

from __future__ import annotations

from typing import NamedTuple


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
