"""Split one node of a bounding volume hierarchy by the surface area heuristic (compiled)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kernels import jit
from kernels.arrays import FloatArray, IntArray

BINS = 16
"""Bins along each axis, between which cuts are compared."""


class Workspace(NamedTuple):
    """Room in which nodes are split one after another: allocated once, not for each.

    Attributes
    ----------
    middle : (m, 3) float64
        Twice the middle of each member, in the order of the node's.
    part, part_own : (m,) int64, (m, 6) float64
        Members of the second child, and their boxes.
    span : (2, 3) float64
        Least and greatest of the node's middles.
    held : (3, BINS) int64
        Members in each bin along each axis.
    box : (3, BINS, 6) float64
        Around them.
    cost : (BINS,) float64
        Of a cut above each bin.
    """

    middle: FloatArray
    part: IntArray
    part_own: FloatArray
    span: FloatArray
    held: IntArray
    box: FloatArray
    cost: FloatArray


@jit
def new_workspace(members: int) -> Workspace:
    """Return room for nodes of at most so many members."""
    return Workspace(
        np.empty((members, 3)),
        np.empty(members, dtype=np.int64),
        np.empty((members, 6)),
        np.empty((2, 3)),
        np.empty((3, BINS), dtype=np.int64),
        np.empty((3, BINS, 6)),
        np.empty(BINS),
    )


@jit
def _clear(box: FloatArray) -> None:
    """Make a box hold nothing."""
    for c in range(3):
        box[c] = np.inf
        box[3 + c] = -np.inf


@jit
def _take_in(box: FloatArray, other: FloatArray) -> None:
    """Widen a box to hold another."""
    for c in range(3):
        box[c] = min(box[c], other[c])
        box[3 + c] = max(box[3 + c], other[3 + c])


@jit
def enclose(own: FloatArray, box: FloatArray) -> None:
    """Write the box around members' boxes ``own`` (k, 6) into ``box`` (6,)."""
    _clear(box)
    for k in range(len(own)):
        _take_in(box, own[k])


@jit
def partition_members(own: FloatArray, chosen: IntArray, cheapest: bool, room: Workspace) -> int:
    """Put members of the first child before those of the second; return how many it has.

    Cut where it is cheapest, else in the middle of the order they are in. ``own`` (k, 6) are the
    boxes of the members ``chosen`` (k,), and move with them: read in a row, they are read fast.
    """
    axis, last = _cheapest_cut(own, room) if cheapest else (-1, 0)
    if axis < 0:
        return len(chosen) // 2
    kept, moved = 0, 0
    for k in range(len(chosen)):
        if _bin(room, k, axis) <= last:
            chosen[kept] = chosen[k]
            for c in range(6):
                own[kept, c] = own[k, c]
            kept += 1
        else:
            room.part[moved] = chosen[k]
            for c in range(6):
                room.part_own[moved, c] = own[k, c]
            moved += 1
    for k in range(moved):
        chosen[kept + k] = room.part[k]
        for c in range(6):
            own[kept + k, c] = room.part_own[k, c]
    return kept


@jit
def _cheapest_cut(own: FloatArray, room: Workspace) -> tuple[int, int]:
    """Axis and last bin of the first child, of the cheapest cut; axis -1 where none parts."""
    _fill_bins(own, room)
    best, axis, last = np.inf, -1, 0
    for c in range(3):
        _costs(room, c)
        for k in range(BINS - 1):
            if room.cost[k] < best:
                best, axis, last = room.cost[k], c, k
    return axis, last


@jit
def _fill_bins(own: FloatArray, room: Workspace) -> None:
    """Count the members in each bin along each axis, and find the boxes around them."""
    for c in range(3):
        room.span[0, c], room.span[1, c] = np.inf, -np.inf
    for k in range(len(own)):
        for c in range(3):
            middle = own[k, c] + own[k, 3 + c]
            room.middle[k, c] = middle
            room.span[0, c] = min(room.span[0, c], middle)
            room.span[1, c] = max(room.span[1, c], middle)
    for c in range(3):
        for b in range(BINS):
            room.held[c, b] = 0
            _clear(room.box[c, b])
    for k in range(len(own)):
        for c in range(3):
            b = _bin(room, k, c)
            room.held[c, b] += 1
            _take_in(room.box[c, b], own[k])


@jit
def _bin(room: Workspace, k: int, axis: int) -> int:
    """Number of the bin that the middle of a member lies in; 0 where no middles differ."""
    low = room.span[0, axis]
    span = room.span[1, axis] - low
    if span > 0.0:
        return min(int((room.middle[k, axis] - low) / span * BINS), BINS - 1)
    return 0


@jit
def _costs(room: Workspace, axis: int) -> None:
    """Cost of a cut above each bin but the last: members of both sides times their faces."""
    room.cost[:] = 0.0
    for way in range(2):
        held = 0
        x0, y0, z0, x1, y1, z1 = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
        for k in range(BINS - 1):
            one = BINS - 1 - k if way else k
            held += room.held[axis, one]
            box = room.box[axis, one]
            x0, y0, z0 = min(x0, box[0]), min(y0, box[1]), min(z0, box[2])
            x1, y1, z1 = max(x1, box[3]), max(y1, box[4]), max(z1, box[5])
            # Half the surface of the box: how often a search comes to it, in proportion.
            x, y, z = x1 - x0, y1 - y0, z1 - z0
            room.cost[one - way] += held * (x * y + y * z + z * x) if held else np.inf
