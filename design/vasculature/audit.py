"""Audit a finished tree: what collides or leaves the tissue; prune what does."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.tissue.grid import depth_along
from design.vasculature.fit import Room, neighbours_of, seven, widening
from design.vasculature.index import CellIndex
from design.vasculature.options import Law
from design.vasculature.state import place, refresh, refresh_upwards
from kernels import jit


@jit
def measure_room(segments: Any, count: int, index: CellIndex, room: Room, smallest: float) -> int:
    """Derive every segment's allowed radius from tissue and neighbours.

    The index must list all segments with their present radii. A terminal thinner than
    ``smallest`` is allowed no radius at all.

    Returns
    -------
    int
        How many are wider than allowed.
    """
    segments[0].allowed = np.inf
    for i in range(1, count):
        s = segments[i]
        need = s.radius + room.wall
        depth = depth_along(room.grid, s.px, s.py, s.pz, s.dx, s.dy, s.dz, need)
        s.allowed = depth - room.wall
    for i in range(count):
        s = segments[i]
        parent, sibling, left, right = neighbours_of(segments, i)
        skip = seven(i, parent, sibling, left, right, -1, -1)
        free = widening(
            index, segments, room, s.px, s.py, s.pz, s.dx, s.dy, s.dz, s.radius, skip, True
        )
        s.allowed = min(s.allowed, free * s.radius)
        if s.left < 0 and s.radius < smallest:
            s.allowed = 0.0
    return too_wide(segments, count)


@jit
def too_wide(segments: Any, count: int) -> int:
    """How many segments are wider than allowed."""
    bad = 0
    for i in range(count):
        bad += segments[i].radius > segments[i].allowed
    return bad


@jit
def prune(segments: Any, count: int, index: CellIndex, room: Room, law: Law) -> int:
    """Take away branches until no segment is wider than allowed; return the new count.

    Of a segment that is too wide the smaller branch at its end is taken, or itself when it is a
    terminal, and what is left is joined straight. Where the straight segment doesn't fit, the
    whole branch goes. A tree pruned to its stem returns 1. The index isn't kept up: list anew.
    """
    gone = np.zeros(count, np.uint8)
    for i in range(1, count):
        if gone[i] == 0 and segments[i].radius > segments[i].allowed:
            _take(segments, _smaller_end(segments, i), gone, index, room, law)
            if segments[0].left < 0:
                return 1
    return _compact(segments, count, gone)


@jit
def _smaller_end(segments: Any, i: int) -> int:
    s = segments[i]
    if s.left < 0:
        return i
    if segments[s.left].terminals <= segments[s.right].terminals:
        return int(s.left)
    return int(s.right)


@jit
def _take(segments: Any, i: int, gone: Any, index: CellIndex, room: Room, law: Law) -> None:
    while True:
        parent, sibling, _, _ = neighbours_of(segments, i)
        if parent == 0:
            segments[0].left, segments[0].right = -1, -1
            return
        up, kept = segments[parent], segments[sibling]
        if _straight_fits(segments, index, room, int(parent), int(sibling), i):
            break
        i = int(parent)
    _mark(segments, i, gone)
    gone[sibling] = 1
    place(segments, int(parent), (up.px, up.py, up.pz), (kept.dx, kept.dy, kept.dz))
    up.left, up.right = kept.left, kept.right
    up.radius = max(up.radius, kept.radius)
    up.allowed = np.inf
    if up.left >= 0:
        segments[up.left].parent, segments[up.right].parent = parent, parent
    refresh(segments, int(parent), law)
    refresh_upwards(segments, up.parent, law)


@jit
def _straight_fits(
    segments: Any, index: CellIndex, room: Room, parent: int, kept: int, taken: int
) -> bool:
    """Whether ``parent`` and ``kept`` can be one straight segment once ``taken`` is gone."""
    a, b = segments[parent], segments[kept]
    radius = a.radius
    need = radius + room.wall
    if depth_along(room.grid, a.px, a.py, a.pz, b.dx, b.dy, b.dz, need) < need:
        return False
    above, aunt, _, _ = neighbours_of(segments, parent)
    skip = seven(parent, kept, taken, above, aunt, b.left, b.right)
    free = widening(index, segments, room, a.px, a.py, a.pz, b.dx, b.dy, b.dz, radius, skip, False)
    return bool(free >= 1.0)


@jit
def _mark(segments: Any, i: int, gone: Any) -> None:
    stack = np.empty(2 * segments[i].terminals + 2, np.int32)
    stack[0] = i
    top = 1
    while top > 0:
        top -= 1
        here = stack[top]
        gone[here] = 1
        if segments[here].left >= 0:
            stack[top] = segments[here].left
            stack[top + 1] = segments[here].right
            top += 2


@jit
def _compact(segments: Any, count: int, gone: Any) -> int:
    number = np.full(count + 1, -1, np.int32)
    size = 0
    for i in range(count):
        if gone[i] == 0:
            number[i] = size
            size += 1
    for i in range(count):
        if gone[i] == 0:
            s = segments[i]
            # number[-1] is -1: no parent, no child.
            s.parent, s.left, s.right = number[s.parent], number[s.left], number[s.right]
            segments[number[i]] = s
    return size
