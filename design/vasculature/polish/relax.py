"""Move branch points of a tree towards lower cost, in sweeps over the whole tree."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.vasculature.growth.clearances import Clearances
from design.vasculature.growth.cost import joined_load
from design.vasculature.growth.index import REACH, CellIndex, insert
from design.vasculature.growth.state import place, refresh, refresh_upwards, spread_down
from design.vasculature.options import Law
from design.vasculature.polish.cost import fork_slopes, relengthened, walk_up
from design.vasculature.polish.fit import far_end, length_of, near_end, node_fits, node_slack
from kernels import jit

STEPS = np.array([1.0, 0.5, 0.2])
"""Parts of the way to the best place that are tried."""

SIDEWAYS = 4
"""Places beside that way that are tried where nothing on it fits."""

ALONG, ASIDE = 0.3, 0.4
"""Where those are, over the way's length."""

GAIN = 1e-9
"""A move must lower the cost by this part of the mean cost of a segment."""

_WEISZFELD = 6
_FRESH = 64


@jit
def root_radius(segments: Any, flow_over_drop: float) -> float:
    """Root radius by the cost as it stands, mm."""
    root = segments[0]
    return float(np.sqrt(np.sqrt(flow_over_drop * root.load / root.flow)))


@jit
def all_radii(segments: Any, flow_over_drop: float, law: Law) -> float:
    """Derive all radii and derivatives; return the smallest radius."""
    return spread_down(segments, len(segments), root_radius(segments, flow_over_drop), 1.0, law)


@jit
def node_value(
    segments: Any, i: int, b: Any, flow_over_drop: float, law: Law
) -> tuple[float, tuple[float, float, float]]:
    """Cost with the far end of segment ``i`` at ``b``, and the radii of it and its children."""
    s = segments[i]
    one, two = segments[s.left], segments[s.right]
    load0, spend0 = relengthened(one, length_of(b, far_end(one)), law)
    load1, spend1 = relengthened(two, length_of(b, far_end(two)), law)
    up = length_of(near_end(s), b)
    load, spend, m = joined_load(load0, spend0, load1, spend1, up, s.flow * s.thick, law)
    cost, radius4 = walk_up(segments, i, load, spend, s.flow, law)
    radius = np.sqrt(np.sqrt(flow_over_drop * radius4))
    low0, low1 = np.sqrt(np.sqrt(load0 / m)), np.sqrt(np.sqrt(load1 / m))
    return cost, (radius, radius * low0, radius * low1)


@jit
def best_node(segments: Any, i: int, law: Law) -> tuple[float, float, float]:
    """Weighted Fermat point of a branch point's three neighbours, the weights following it."""
    s = segments[i]
    one, two = segments[s.left], segments[s.right]
    p, a, c = near_end(s), far_end(one), far_end(two)
    bx, by, bz = far_end(s)
    for _ in range(_WEISZFELD):
        b = (bx, by, bz)
        up, low0, low1 = length_of(p, b), length_of(b, a), length_of(b, c)
        load0, spend0 = relengthened(one, low0, law)
        load1, spend1 = relengthened(two, low1, law)
        w, w0, w1 = fork_slopes(
            (s.by_load, s.by_spend),
            (up, low0, low1),
            (load0, load1),
            (spend0, spend1),
            (s.flow * s.thick, one.flow * one.thick, two.flow * two.thick),
            law,
        )
        w, w0, w1 = max(0.0, w) / up, max(0.0, w0) / low0, max(0.0, w1) / low1
        total = w + w0 + w1
        if not total > 0.0:
            break
        nx = (w * p[0] + w0 * a[0] + w1 * c[0]) / total
        ny = (w * p[1] + w0 * a[1] + w1 * c[1]) / total
        nz = (w * p[2] + w0 * a[2] + w1 * c[2]) / total
        moved = abs(nx - bx) + abs(ny - by) + abs(nz - bz)
        bx, by, bz = nx, ny, nz
        if moved < 1e-3 * (up + low0 + low1):
            break
    return bx, by, bz


@jit
def commit_node(
    segments: Any, index: CellIndex, room: Clearances, law: Law, i: int, b: Any, radii: Any
) -> bool:
    """Move the far end of segment ``i``; False when the index is full."""
    s = segments[i]
    place(segments, i, near_end(s), b)
    place(segments, s.left, b, far_end(segments[s.left]))
    place(segments, s.right, b, far_end(segments[s.right]))
    refresh(segments, s.left, law)
    refresh(segments, s.right, law)
    refresh_upwards(segments, i, law)
    done = True
    for n in range(3):
        which = int(i if n == 0 else (s.left if n == 1 else s.right))
        segments[which].radius = radii[n]
        listed = insert(index, which, segments[which], REACH * radii[n] + room.clearance)
        done = done and listed
    return done


@jit
def _try_node(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    i: int,
    b: Any,
    below: float,
    joint: float,
) -> int:
    """Move a node if that lowers the cost below ``below`` and fits: 0 no, 1 yes, 2 index full."""
    cost, radii = node_value(segments, i, b, flow_over_drop, law)
    if not cost < below or not node_fits(index, segments, room, i, b, radii, joint):
        return 0
    return 1 if commit_node(segments, index, room, law, i, b, radii) else 2


@jit
def _aside(here: Any, to: Any, way: float, angle: float) -> tuple[float, float, float]:
    """A place part of the way ``to`` and beside it, at an angle about it."""
    wx, wy, wz = to
    # Two directions at right angles to the way and to each other.
    if abs(wx) < 0.6 * way:
        ux, uy, uz = 0.0, wz, -wy
    else:
        ux, uy, uz = -wz, 0.0, wx
    norm = way / np.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux * norm, uy * norm, uz * norm
    vx, vy, vz = (wy * uz - wz * uy) / way, (wz * ux - wx * uz) / way, (wx * uy - wy * ux) / way
    cu, cv = ASIDE * np.cos(angle), ASIDE * np.sin(angle)
    return (
        here[0] + ALONG * wx + cu * ux + cv * vx,
        here[1] + ALONG * wy + cu * uy + cv * vy,
        here[2] + ALONG * wz + cu * uz + cv * vz,
    )


@jit
def relax_node(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    i: int,
    turn: float,
) -> int:
    """Move one branch point to where the cost is lower: 0 stayed, 1 moved, 2 and index full."""
    s = segments[i]
    here = far_end(s)
    x, y, z = best_node(segments, i, law)
    wx, wy, wz = x - here[0], y - here[1], z - here[2]
    way = np.sqrt(wx * wx + wy * wy + wz * wz)
    if not way > 1e-4 * s.length:
        return 0
    below = segments[0].spend * (1.0 - GAIN / len(segments))
    radii = (s.radius, segments[s.left].radius, segments[s.right].radius)
    # A joint that is too tight as it is may stay so, but not get tighter.
    joint = min(0.0, node_slack(segments, room, i, here, radii))
    for step in STEPS:
        b = (here[0] + step * wx, here[1] + step * wy, here[2] + step * wz)
        done = _try_node(segments, index, room, law, flow_over_drop, i, b, below, joint)
        if done > 0:
            return done
    for n in range(SIDEWAYS):
        b = _aside(here, (wx, wy, wz), way, turn + 2.0 * np.pi * n / SIDEWAYS)
        done = _try_node(segments, index, room, law, flow_over_drop, i, b, below, joint)
        if done > 0:
            return done
    return 0


@jit
def relax(
    segments: Any,
    index: CellIndex,
    room: Clearances,
    law: Law,
    flow_over_drop: float,
    nodes: Any,
    first: int,
    turn: float,
) -> tuple[int, int]:
    """Relax the far ends of ``nodes[first:]`` in turn; radii are derived anew now and then.

    Returns
    -------
    int, int
        The next one (before the end when the index is full), and how many moved.
    """
    moved = 0
    fresh = max(_FRESH, len(nodes) // _FRESH)
    for n in range(first, len(nodes)):
        i = nodes[n]
        done = relax_node(segments, index, room, law, flow_over_drop, i, turn)
        if done > 0:
            moved += 1
            if moved % fresh == 0:
                all_radii(segments, flow_over_drop, law)
        if done == 2:
            return n + 1, moved
    return len(nodes), moved
