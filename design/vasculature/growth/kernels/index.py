"""Index a tree's segments by grid cells; find those near a point or capsule."""

from __future__ import annotations

from math import floor, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry import point_segment, segment_segment
from design.tissue import Tissue
from design.tissue.grid import GridArrays, depth_along
from design.vasculature.growth.kernels.cost import TRUNK, Segments
from design.vasculature.options import GrowthOptions, Limits
from kernels import jit, scalar_jit
from kernels.arrays import FloatArray

REACH = 1.3
"""Capsules are listed with this much larger radii: they may grow before the next rebuild."""


class Listing(NamedTuple):
    """Lengths by which segments are listed and told apart."""

    cell_factor: float = 1.2
    """Edge of a cell over the mean spacing of terminals."""
    leaving_factor: float = 1.5
    """Path along a branch, over its radius and its trunk's, within which it still leaves
    that."""


class Reserve(NamedTuple):
    """Factor on the radii with which a trial must fit: later terminals widen its path."""

    least: float = 1.02
    per_e_fold: float = 0.03
    """Added to the least for each factor e by which the tree has yet to grow."""
    most: float = 1.15


LISTING, RESERVE = Listing(), Reserve()

Seven = tuple[np.int64, np.int64, np.int64, np.int64, np.int64, np.int64, np.int64]


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
        Factor on the radii of a trial fork and its neighbours; see `Reserve`.
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


def clearances_of(tissue: Tissue, options: GrowthOptions) -> Clearances:
    """The distances and limits that the options ask for."""
    return Clearances(
        tissue.grid.arrays,
        options.clearance_mm,
        options.clearance_mm,
        options.clearance_ratio,
        options.length_to_radius,
        RESERVE.least,
        options.limits,
        np.inf,
    )


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
    item, following : (entries,) int32
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


def empty_index(
    bounds: NDArray[np.float64], cell_mm: float, entries: int, segments: int
) -> CellIndex:
    """Create an index over ``bounds`` (2, 3), mm, for so many entries and segments."""
    shape = np.maximum(1, np.ceil((bounds[1] - bounds[0]) / cell_mm)).astype(np.int64)
    return CellIndex(
        bounds[0].copy(),
        float(cell_mm),
        shape,
        np.full(int(shape.prod()), -1, np.int32),
        np.empty(entries, np.int32),
        np.empty(entries, np.int32),
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
    """List segment ``i`` in all cells within ``reach`` of its axis; False when it is full."""
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


@jit
def list_from(
    segments: Any, first: int, end: int, index: CellIndex, clearances: Clearances
) -> bool:
    """List segments ``first`` to ``end`` in an index; False when it is full."""
    for i in range(first, end):
        s = segments[i]
        if not insert(index, i, s, REACH * s.radius + clearances.clearance):
            return False
    return True


def index_segments(
    bounds: FloatArray,
    cell_mm: float,
    segments: Segments,
    own: int,
    others: int,
    clearances: Clearances,
) -> CellIndex:
    """An index of the first ``own`` segments and the last ``others``, half empty."""
    end = len(segments)
    entries = 16 * end + 4096
    while True:
        index = empty_index(bounds, cell_mm, entries, end)
        done = list_from(segments, 0, own, index, clearances)
        done = done and list_from(segments, end - others, end, index, clearances)
        if done and index.used[0] < 0.5 * entries:
            return index
        entries *= 2


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
    nearest, away : (k,)
        Receive segments and distances, mm.

    Returns
    -------
    int
        How many were found (fewer than k only when there are fewer).
    """
    most = len(nearest)
    size = 0
    index.query[0] += 1
    query = index.query[0]
    ci, _ = cell_range(index, 0, x, x)
    cj, _ = cell_range(index, 1, y, y)
    ck, _ = cell_range(index, 2, z, z)
    widest = max(index.shape[0], max(index.shape[1], index.shape[2]))
    for ring in range(widest):
        # Whatever isn't listed in the rings done is at least this far.
        if size == most and away[size - 1] <= (ring - 1) * index.cell:
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
                        if size == most and d >= away[size - 1]:
                            continue
                        if s.terminals == 0:
                            continue
                        if d < least:
                            nearest[0], away[0] = i, d
                            return 1
                        at = size if size < most else most - 1
                        while at > 0 and away[at - 1] > d:
                            away[at] = away[at - 1]
                            nearest[at] = nearest[at - 1]
                            at -= 1
                        away[at] = d
                        nearest[at] = i
                        size = min(most, size + 1)
    return size


@scalar_jit
def clearance_between(clearances: Clearances, one: float, two: float) -> float:
    """Clearance between vessels of radii ``one`` and ``two``, mm."""
    return max(clearances.clearance, clearances.ratio * min(one, two))


@scalar_jit
def widest_of(segments: Any, clearances: Clearances, i: int) -> float:
    """Radius from which on segment ``i`` takes on no more terminals, mm; inf for a trunk's."""
    if segments[i].given == TRUNK or not clearances.widest_branch < np.inf:
        return np.inf
    return clearances.widest_branch * segments[0].radius


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


@jit
def seven_integers(a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any) -> Seven:
    """Make a tuple of equal integers, whatever their widths."""
    wide = np.int64
    return (wide(a), wide(b), wide(c), wide(d), wide(e), wide(f), wide(g))


@scalar_jit
def pair_growth_factor(clearances: Clearances, away: float, one: float, two: float) -> float:
    """Factor by which vessels ``away`` (mm) from each other could both widen until they collide."""
    both = one + two
    factor = away / (both + clearances.ratio * min(one, two))
    if clearances.clearance > 0.0:
        # The fixed part of the clearance doesn't grow with the radii.
        factor = min(factor, (away - clearances.clearance) / both)
    return factor


@scalar_jit
def away_from_trunk(
    s: Any,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    radius: float,
    away: float,
) -> float:
    """Distance of a branch from a trunk's segment; where it begins in its lumen, once outside.

    A trunk's pieces may be shorter than it is wide, so that a branch of one begins within the
    next. ``away`` is the distance of the axes.
    """
    inner, _ = point_segment(ax, ay, az, s.px, s.py, s.pz, s.dx, s.dy, s.dz)
    if inner >= s.radius:
        return away
    x, y, z = bx - ax, by - ay, bz - az
    part = LISTING.leaving_factor * (s.radius + radius) / max(1e-12, np.sqrt(x * x + y * y + z * z))
    if part >= 1.0:
        return np.inf
    x, y, z = ax + part * x, ay + part * y, az + part * z
    return float(segment_segment(x, y, z, bx, by, bz, s.px, s.py, s.pz, s.dx, s.dy, s.dz)[0])


@scalar_jit
def growth_factor(
    index: CellIndex,
    segments: Any,
    clearances: Clearances,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    radius: float,
    skip: Seven,
    record: bool,
) -> float:
    """How far a capsule and its neighbours could grow, all by one factor, before they collide.

    Parameters
    ----------
    skip : seven int
        Segments left out (itself, and those that share a node with it), or -1.
    record : bool
        Lower the neighbours' ``allowed`` radii to that factor.

    Returns
    -------
    float
        Below 1 when there is a collision; at most `REACH`. Without ``record`` the search ends
        below the reserve of ``clearances``.
    """
    least = REACH
    reach = REACH * radius
    index.query[0] += 1
    query = index.query[0]
    for i in skip:
        if i >= 0:
            index.stamp[i] = query
    i0, i1 = cell_range(index, 0, min(ax, bx) - reach, max(ax, bx) + reach)
    j0, j1 = cell_range(index, 1, min(ay, by) - reach, max(ay, by) + reach)
    k0, k1 = cell_range(index, 2, min(az, bz) - reach, max(az, bz) + reach)
    far = reach + 0.8660254037844386 * index.cell
    several = i1 > i0 or j1 > j0 or k1 > k0
    for a in range(i0, i1 + 1):
        x = index.origin[0] + (a + 0.5) * index.cell
        for b in range(j0, j1 + 1):
            y = index.origin[1] + (b + 0.5) * index.cell
            for c in range(k0, k1 + 1):
                entry = index.head[(a * index.shape[1] + b) * index.shape[2] + c]
                if entry < 0:
                    continue
                if several:
                    z = index.origin[2] + (c + 0.5) * index.cell
                    if point_segment(x, y, z, ax, ay, az, bx, by, bz)[0] > far:
                        continue
                while entry >= 0:
                    i = index.item[entry]
                    entry = index.following[entry]
                    if index.stamp[i] == query:
                        continue
                    index.stamp[i] = query
                    s = segments[i]
                    d, _, _ = segment_segment(
                        ax, ay, az, bx, by, bz, s.px, s.py, s.pz, s.dx, s.dy, s.dz
                    )
                    if s.given != 0:
                        d = away_from_trunk(s, ax, ay, az, bx, by, bz, radius, d)
                    factor = pair_growth_factor(clearances, d, radius, s.radius)
                    if factor < least:
                        least = factor
                        if least < clearances.reserve and not record:
                            return least
                    if record and factor * s.radius < s.allowed:
                        s.allowed = factor * s.radius
    return least


@scalar_jit
def in_tissue(
    clearances: Clearances,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    radius: float,
) -> bool:
    """Whether a capsule keeps its distance from the tissue's surface."""
    need = clearances.reserve * radius + clearances.wall
    return bool(depth_along(clearances.grid, ax, ay, az, bx, by, bz, need) >= need)


@jit
def clear_of(
    segments: Any, index: CellIndex, clearances: Clearances, begin: Any, points: Any, radius: float
) -> Any:
    """Whether capsules from ``begin`` (3,) to each of ``points`` (n, 3) clear all that is listed.

    The index must list the vessels of others alone.
    """
    free = np.zeros(len(points), np.bool_)
    skip = seven_integers(-1, -1, -1, -1, -1, -1, -1)
    for n in range(len(points)):
        t = points[n]
        x, y, z = begin[0], begin[1], begin[2]
        least = growth_factor(
            index, segments, clearances, x, y, z, t[0], t[1], t[2], radius, skip, False
        )
        free[n] = least >= clearances.reserve
    return free
