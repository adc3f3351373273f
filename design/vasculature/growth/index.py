"""Index a tree's segments by grid cells, to find those near a point or capsule."""

from __future__ import annotations

from math import floor, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry import point_segment
from design.tissue.grid import GridArrays
from design.vasculature.growth.state import TRUNK
from design.vasculature.options import Limits
from kernels import scalar_jit

REACH = 1.3
"""Capsules are listed with this much larger radii: they may grow before the next rebuild."""


class CellIndex(NamedTuple):
    """Linked lists of segments, one list a cell.

    Entries may be stale after a segment moved; they cost time, never a miss, because whatever
    moves is listed anew. The same segment may be listed twice in a cell.

    Attributes
    ----------
    origin : (3,) float64, mm
    cell : float, mm
    shape : (3,) int64
    head : (a * b * c,) int32
        First entry of each cell, -1 for none.
    item, following : (room,) int32
        Segment of an entry, and the next entry.
    used : (1,) int64
        Entries in use.
    stamp : (segments,) int32
        Scratch: which query saw a segment last.
    query : (1,) int32
        Scratch: number of the last query.
    """

    origin: NDArray[np.float64]
    cell: float
    shape: NDArray[np.int64]
    head: NDArray[np.int32]
    item: NDArray[np.int32]
    following: NDArray[np.int32]
    used: NDArray[np.int64]
    stamp: NDArray[np.int32]
    query: NDArray[np.int32]


def empty_index(bounds: NDArray[np.float64], cell_mm: float, room: int, segments: int) -> CellIndex:
    """Create an index over ``bounds`` (2, 3), mm, with room for entries and segments."""
    shape = np.maximum(1, np.ceil((bounds[1] - bounds[0]) / cell_mm)).astype(np.int64)
    return CellIndex(
        bounds[0].copy(),
        float(cell_mm),
        shape,
        np.full(int(shape.prod()), -1, np.int32),
        np.empty(room, np.int32),
        np.empty(room, np.int32),
        np.zeros(1, np.int64),
        np.zeros(segments, np.int32),
        np.zeros(1, np.int32),
    )


@scalar_jit
def cell_range(index: CellIndex, axis: int, low: float, high: float) -> tuple[int, int]:
    """First and last cell along an axis that an interval touches, held within the grid."""
    last = index.shape[axis] - 1
    first = floor((low - index.origin[axis]) / index.cell)
    end = floor((high - index.origin[axis]) / index.cell)
    return min(max(first, 0), last), min(max(end, 0), last)


@scalar_jit
def insert(index: CellIndex, i: int, s: Any, reach: float) -> bool:
    """List segment ``i`` in all cells within ``reach`` of its axis; False when out of room."""
    i0, i1 = cell_range(index, 0, min(s.px, s.dx) - reach, max(s.px, s.dx) + reach)
    j0, j1 = cell_range(index, 1, min(s.py, s.dy) - reach, max(s.py, s.dy) + reach)
    k0, k1 = cell_range(index, 2, min(s.pz, s.dz) - reach, max(s.pz, s.dz) + reach)
    # A cell's points are within half its diagonal of its centre.
    far = reach + 0.5 * sqrt(3.0) * index.cell
    small = i0 == i1 and j0 == j1 and k0 == k1
    for a in range(i0, i1 + 1):
        x = index.origin[0] + (a + 0.5) * index.cell
        for b in range(j0, j1 + 1):
            y = index.origin[1] + (b + 0.5) * index.cell
            for c in range(k0, k1 + 1):
                z = index.origin[2] + (c + 0.5) * index.cell
                if not small:
                    d, _ = point_segment(x, y, z, s.px, s.py, s.pz, s.dx, s.dy, s.dz)
                    if d > far:
                        continue
                at = index.used[0]
                if at >= len(index.item):
                    return False
                here = (a * index.shape[1] + b) * index.shape[2] + c
                index.item[at] = i
                index.following[at] = index.head[here]
                index.head[here] = at
                index.used[0] = at + 1
    return True


@scalar_jit
def nearest_segments(
    index: CellIndex,
    segments: Any,
    x: float,
    y: float,
    z: float,
    least: float,
    nearest: Any,
    away: Any,
) -> int:
    """The segments nearest to a point by their axes, nearest first; those of others left out.

    Parameters
    ----------
    least : float, mm
        The search ends at a segment that is nearer, which is then the only one found.
    found, away : (k,)
        Receive segments and distances, mm.

    Returns
    -------
    int
        How many were found (fewer than k only when there are fewer).
    """
    room = len(nearest)
    size = 0
    index.query[0] += 1
    query = index.query[0]
    ci, _ = cell_range(index, 0, x, x)
    cj, _ = cell_range(index, 1, y, y)
    ck, _ = cell_range(index, 2, z, z)
    widest = max(index.shape[0], max(index.shape[1], index.shape[2]))
    for ring in range(widest):
        # Whatever isn't listed in the rings done is at least this far.
        if size == room and away[size - 1] <= (ring - 1) * index.cell:
            break
        for a in range(max(0, ci - ring), min(index.shape[0] - 1, ci + ring) + 1):
            for b in range(max(0, cj - ring), min(index.shape[1] - 1, cj + ring) + 1):
                edge = abs(a - ci) == ring or abs(b - cj) == ring
                step = 1 if edge or ring == 0 else 2 * ring
                for c in range(ck - ring, ck + ring + 1, step):
                    if c < 0 or c >= index.shape[2]:
                        continue
                    entry = index.head[(a * index.shape[1] + b) * index.shape[2] + c]
                    while entry >= 0:
                        i = index.item[entry]
                        entry = index.following[entry]
                        if index.stamp[i] == query:
                            continue
                        index.stamp[i] = query
                        s = segments[i]
                        d, _ = point_segment(x, y, z, s.px, s.py, s.pz, s.dx, s.dy, s.dz)
                        if size == room and d >= away[size - 1]:
                            continue
                        if s.terminals == 0:
                            continue
                        if d < least:
                            nearest[0], away[0] = i, d
                            return 1
                        at = size if size < room else room - 1
                        while at > 0 and away[at - 1] > d:
                            away[at] = away[at - 1]
                            nearest[at] = nearest[at - 1]
                            at -= 1
                        away[at] = d
                        nearest[at] = i
                        size = min(room, size + 1)
    return size


# Data classes: clearances that a growing tree must keep, and a trial bifurcation.

MARGIN, MARGIN_LEFT, MARGIN_AT_MOST = 1.02, 0.03, 1.15
"""Trial forks must fit with larger radii, because every later terminal widens its path: by the
first factor, plus the second times the logarithm of how often the tree has yet to grow by e, the
third at most."""


class Clearances(NamedTuple):
    """The tissue and the distances to be kept, as kernels take them.

    Attributes
    ----------
    grid : GridArrays
    wall : float, mm
        Kept from the tissue's surface.
    clearance : float, mm
    ratio : float
        Clearance over the thinner radius; the larger of the two counts.
    length_to_radius : float
    reserve : float
        Factor on the radii of a trial fork and its neighbours; see `MARGIN`.
    limits : Limits
        On angles and flows at joints.
    widest_branch : float
        Of a given trunk, over the root's radius: one as wide takes on no more terminals; inf for
        no limit.
    """

    grid: GridArrays
    wall: float
    clearance: float
    ratio: float
    length_to_radius: float
    reserve: float
    limits: Limits
    widest_branch: float


class TrialBifurcation(NamedTuple):
    """A trial bifurcation on a segment: its place, the new end, three radii (mm).

    ``flow`` and ``thick`` are what the new branch brings; see `cost.Sprout`.
    """

    segment: np.int64
    bx: float
    by: float
    bz: float
    tx: float
    ty: float
    tz: float
    up: float
    low: float
    new: float
    flow: float
    thick: float


@scalar_jit
def kept_apart(room: Clearances, one: float, two: float) -> float:
    """Clearance between vessels of radii ``one`` and ``two``, mm."""
    return max(room.clearance, room.ratio * min(one, two))


@scalar_jit
def widest_of(segments: Any, room: Clearances, i: int) -> float:
    """Radius from which on segment ``i`` takes on no more terminals, mm; inf for a trunk's."""
    if segments[i].given == TRUNK or not room.widest_branch < np.inf:
        return np.inf
    return room.widest_branch * segments[0].radius


@scalar_jit
def neighbours_of(segments: Any, index: Any) -> tuple[np.int64, np.int64, np.int64, np.int64]:
    """Parent, sibling and children of a segment, -1 for none."""
    s = segments[index]
    sibling = np.int64(-1)
    if s.parent >= 0:
        above = segments[s.parent]
        sibling = np.int64(above.right if above.left == index else above.left)
    # One width for all four, so that callers may loop over them.
    return np.int64(s.parent), np.int64(sibling), np.int64(s.left), np.int64(s.right)
