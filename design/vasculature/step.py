"""One growth step: propose where a new terminal joins the tree, and commit it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from design.tissue.depth import least_depth_along
from design.tissue.grid import read
from design.vasculature.bifurcation import best_place, distance, split_value
from design.vasculature.cost import ENOUGH, climb
from design.vasculature.fit import Seven, fits, seven, widening
from design.vasculature.index import REACH, CellIndex, insert, nearest_segments
from design.vasculature.options import Law
from design.vasculature.room import Fork, Room, neighbours_of
from design.vasculature.state import place, refresh, refresh_upwards, spread_down
from kernels import jit

CANDIDATES = 10
"""Nearest segments considered for a new terminal."""

TRIED = 4
"""Of these, the cheapest, for which other places than the best are tried."""

ITERATIONS = 8
"""Weiszfeld steps at most."""

PROGRESS = np.dtype(
    [
        ("count", "i8"),
        ("terminals", "i8"),
        ("refresh_at", "i8"),
        ("tried", "i8"),
        ("since", "i8"),
        ("apart", "f8"),
        ("root_radius", "f8"),
        ("smallest", "f8"),
    ]
)
"""Where growth stands.

count : segments; terminals : of them; refresh_at : terminals at which radii are derived anew;
tried : points tried; since : points tried since the last success; apart : share of the mean
spacing that a new terminal must be away from the tree; root_radius : predicted, mm;
smallest : terminal radius, predicted, mm.
"""


class Scale(NamedTuple):
    """What sets the radii of the finished tree.

    Attributes
    ----------
    flow_over_drop : float, µL/(s·Pa)
        Q / Δp at the root.
    root_radius : float, mm
        Fixed radius of the root, or 0 where the pressure drop sets it.
    spread : float
        See `GrowthOptions.terminal_spread`; 0 for no limit.
    goal : int
        Terminals of the finished tree.
    volume : float, mm³
    patience : int
        Points tried without success before nearer ones to the tree are let in: what is far is
        reached by wide vessels only once these have come near.
    """

    flow_over_drop: float
    root_radius: float
    spread: float
    goal: int
    volume: float
    patience: int


DONE, MORE_POINTS, FULL_INDEX, REBUILD = 0, 1, 2, 3
"""Why `grow` returned."""

REFRESH = 24
"""Radii are derived anew each time the tree has grown by one in this many terminals."""

GROWTH_POWER = 0.02
"""Root radius grows with about this power of the number of terminals (measured)."""

THIN_MARGIN = 1.08
"""A new terminal must be this much wider than the limit: later ones make it thinner."""

_RELAX, _TIGHTEN = 0.93, 1.01
_APART = 0.9


@jit
def predicted_root_radius(segments: Any, law: Law, scale: Scale) -> float:
    """Root radius of the finished tree, mm."""
    if scale.root_radius > 0.0:
        return scale.root_radius
    n = segments[0].terminals
    now = np.sqrt(np.sqrt(scale.flow_over_drop * segments[0].load / n))
    return now * (scale.goal / n) ** GROWTH_POWER


@jit
def thinnest(terminals: int, root_radius: float, law: Law, scale: Scale) -> float:
    """Smallest radius that a terminal may have in a tree of so many, mm; 0 for no limit."""
    if scale.spread <= 0.0:
        return 0.0
    return THIN_MARGIN * root_radius * terminals ** (-1.0 / law.gamma) / scale.spread


@jit
def trial(
    segments: Any,
    i: int,
    b: Any,
    t: Any,
    law: Law,
) -> tuple[Any, float]:
    """Fork with its radii, and the rise of the cost, of a terminal at ``t`` by way of ``b``."""
    s = segments[i]
    up = distance(s.px, s.py, s.pz, b[0], b[1], b[2])
    low = distance(b[0], b[1], b[2], s.dx, s.dy, s.dz)
    new = distance(b[0], b[1], b[2], t[0], t[1], t[2])
    load, spend, _, _, _, _, _, _, low_load, m = split_value(s, up, low, new, law)
    rise, _, _, r_up = climb(segments, i, load, spend, ENOUGH, law)
    r_low = r_up * np.sqrt(np.sqrt(low_load / m))
    r_new = r_up * np.sqrt(np.sqrt(law.k * new / m))
    return Fork(np.int64(i), b[0], b[1], b[2], t[0], t[1], t[2], r_up, r_low, r_new), rise


@jit
def not_too_thin(segments: Any, fork: Any, limit: float) -> bool:
    """Whether the new terminal, and the parted segment if it is one, are wide enough."""
    if fork.new < limit:
        return False
    return bool(segments[fork.segment].left >= 0 or fork.low >= limit)


@jit
def estimate(segments: Any, i: int, t: Any, place_out: Any, slopes: Any, law: Law) -> float:
    """Best place on segment ``i`` by the linear model, and the model's cost there.

    ``place_out`` (3,) receives the place, ``slopes`` (4,) the model: load, spend and the
    derivatives about which it is linear, with the cost in them.
    """
    s = segments[i]
    bx = (s.px + s.dx + t[0]) / 3.0
    by = (s.py + s.dy + t[1]) / 3.0
    bz = (s.pz + s.dz + t[2]) / 3.0
    load, spend, _, _, _, _, _, _, _, _ = split_value(
        s,
        distance(s.px, s.py, s.pz, bx, by, bz),
        distance(bx, by, bz, s.dx, s.dy, s.dz),
        distance(bx, by, bz, t[0], t[1], t[2]),
        law,
    )
    rise, by_load, by_spend, _ = climb(segments, i, load, spend, ENOUGH, law)
    slopes[0] = rise - by_load * load - by_spend * spend
    slopes[1] = by_load
    slopes[2] = by_spend
    bx, by, bz = best_place(s, t[0], t[1], t[2], by_load, by_spend, ITERATIONS, law)
    place_out[0], place_out[1], place_out[2] = bx, by, bz
    return model(s, place_out, t, slopes, law)


@jit
def model(s: Any, b: Any, t: Any, slopes: Any, law: Law) -> float:
    """Cost of place ``b`` by the linear model."""
    load, spend, _, _, _, _, _, _, _, _ = split_value(
        s,
        distance(s.px, s.py, s.pz, b[0], b[1], b[2]),
        distance(b[0], b[1], b[2], s.dx, s.dy, s.dz),
        distance(b[0], b[1], b[2], t[0], t[1], t[2]),
        law,
    )
    return slopes[0] + slopes[1] * load + slopes[2] * spend


@jit
def propose(
    segments: Any,
    index: CellIndex,
    room: Room,
    law: Law,
    limit: float,
    t: Any,
    found: Any,
    size: int,
) -> tuple[bool, Any]:
    """The cheapest fork that fits, of the segments ``found[:size]``."""
    fork = Fork(np.int64(-1), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    costs = np.full(size, np.inf)
    places = np.empty((size, 3))
    slopes = np.empty((size, 3))
    for n in range(size):
        # The root's own segment is the stem: it stays as the user placed it.
        if found[n] > 0 and segments[found[n]].full == 0:
            costs[n] = estimate(segments, found[n], t, places[n], slopes[n], law)
    order = np.argsort(costs, kind="mergesort")
    for n in order:
        if costs[n] < np.inf:
            fork, _ = trial(segments, found[n], places[n], t, law)
            if not_too_thin(segments, fork, limit) and fits(index, segments, room, fork):
                return True, fork
    others = np.empty((TRIED * 6, 3))
    values = np.full(TRIED * 6, np.inf)
    for rank in range(min(TRIED, size)):
        n = order[rank]
        if costs[n] == np.inf:
            break
        s = segments[found[n]]
        for kind in range(6):
            along, pull = 0.25 + 0.25 * (kind % 3), 0.3 * (kind // 3)
            at = others[rank * 6 + kind]
            at[0] = (1.0 - pull) * (s.px + along * (s.dx - s.px)) + pull * t[0]
            at[1] = (1.0 - pull) * (s.py + along * (s.dy - s.py)) + pull * t[1]
            at[2] = (1.0 - pull) * (s.pz + along * (s.dz - s.pz)) + pull * t[2]
            values[rank * 6 + kind] = model(s, at, t, slopes[n], law)
    for n in np.argsort(values, kind="mergesort"):
        if values[n] == np.inf:
            break
        i = found[order[n // 6]]
        fork, _ = trial(segments, i, others[n], t, law)
        if not_too_thin(segments, fork, limit) and fits(index, segments, room, fork):
            return True, fork
    return False, fork


@jit
def settle(segments: Any, index: CellIndex, room: Room, i: int, skip: Seven) -> bool:
    """Derive how wide segment ``i`` may grow and list it; False when the index is full."""
    s = segments[i]
    most = REACH * s.radius + room.wall
    depth = least_depth_along(room.grid, s.px, s.py, s.pz, s.dx, s.dy, s.dz, most, 0.0)
    free = widening(index, segments, room, s.px, s.py, s.pz, s.dx, s.dy, s.dz, s.radius, skip, True)
    s.allowed = min(depth - room.wall, free * s.radius)
    return insert(index, i, s, REACH * s.radius + room.clearance)


@jit
def commit(segments: Any, count: int, index: CellIndex, room: Room, law: Law, fork: Any) -> bool:
    """Part the fork's segment and add the terminal as segments ``count`` and ``count + 1``.

    The segment itself becomes the upper part; the lower part takes its children. Returns False
    when the index ran out of room (the tree itself is whole).
    """
    i, lower, tip = fork.segment, count, count + 1
    parent, sibling, left, right = neighbours_of(segments, i)
    s = segments[i]
    p = (s.px, s.py, s.pz)
    b = (fork.bx, fork.by, fork.bz)
    place(segments, lower, b, (s.dx, s.dy, s.dz))
    place(segments, tip, b, (fork.tx, fork.ty, fork.tz))
    place(segments, i, p, b)
    segments[lower].parent, segments[tip].parent = i, i
    segments[lower].left, segments[lower].right = left, right
    segments[tip].left, segments[tip].right = -1, -1
    if left >= 0:
        segments[left].parent, segments[right].parent = lower, lower
    s.left, s.right = lower, tip
    s.radius, segments[lower].radius, segments[tip].radius = fork.up, fork.low, fork.new
    segments[lower].full, segments[tip].full = 0, 0
    refresh(segments, lower, law)
    refresh(segments, tip, law)
    refresh_upwards(segments, i, law)
    done = settle(segments, index, room, i, seven(i, parent, sibling, lower, tip, -1, -1))
    done = settle(segments, index, room, lower, seven(lower, i, tip, left, right, -1, -1)) and done
    return settle(segments, index, room, tip, seven(tip, i, lower, -1, -1, -1, -1)) and done


@jit
def derive_radii(segments: Any, progress: Any, law: Law, scale: Scale) -> None:
    """Predict all radii anew."""
    s = progress[0]
    s.root_radius = predicted_root_radius(segments, law, scale)
    s.smallest = spread_down(segments, s.count, s.root_radius, 1.02, law)
    s.refresh_at = s.terminals + max(1, s.terminals // REFRESH)


@jit
def grow(
    segments: Any,
    index: CellIndex,
    room: Room,
    law: Law,
    scale: Scale,
    progress: Any,
    points: Any,
    first: int,
    rebuild_at: int,
) -> tuple[int, int]:
    """Try points from ``first`` on until the goal, the end of the points or a rebuild.

    Returns
    -------
    int, int
        Why it returned (`DONE` ...), and the next point.
    """
    s = progress[0]
    found = np.empty(CANDIDATES, np.int32)
    away = np.empty(CANDIDATES)
    for n in range(first, len(points)):
        if s.terminals >= scale.goal:
            return DONE, n
        if s.terminals >= rebuild_at:
            return REBUILD, n
        t = points[n]
        s.tried += 1
        s.since += 1
        if s.since % scale.patience == 0:
            s.apart *= _RELAX
        spacing = (scale.volume / (s.terminals + 1)) ** (1.0 / 3.0)
        size = nearest_segments(index, segments, t[0], t[1], t[2], found, away)
        if away[0] < s.apart * spacing:
            continue
        limit = thinnest(s.terminals + 1, s.root_radius, law, scale)
        tip = max(limit, 0.5 * s.root_radius * (s.terminals + 1) ** (-1.0 / law.gamma))
        if -read(room.grid, t[0], t[1], t[2]) < tip + room.wall:
            continue
        good, fork = propose(segments, index, room, law, limit, t, found, size)
        if not good:
            continue
        listed = commit(segments, s.count, index, room, law, fork)
        s.count += 2
        s.terminals += 1
        s.since = 0
        s.apart = min(_APART, s.apart * _TIGHTEN)
        if s.terminals >= s.refresh_at:
            derive_radii(segments, progress, law, scale)
        if not listed:
            return FULL_INDEX, n + 1
    return (DONE if s.terminals >= scale.goal else MORE_POINTS), len(points)


@jit
def list_all(segments: Any, count: int, index: CellIndex, room: Room) -> bool:
    """List all segments in an empty index; False when it runs out of room."""
    return list_from(segments, 0, count, index, room)


@jit
def list_from(segments: Any, first: int, end: int, index: CellIndex, room: Room) -> bool:
    """List segments ``first`` to ``end`` in an index; False when it runs out of room."""
    for i in range(first, end):
        s = segments[i]
        if not insert(index, i, s, REACH * s.radius + room.clearance):
            return False
    return True
