"""Find written ink that the needle's shaft enters or nears along a planned toolpath.

The plan orders elements by what the shaft meets at a few places of each. What is then written is
looked at as a whole here: all moves, travels, lifts and descents too, and all places between, by
the joints of docs/embedded.md. The check before a print asks the same of the G-code with a program
of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath.embedded.elements import Elements, Squares, near, sort_stretches
from design.toolpath.embedded.needle import ROUNDING_MM, Needle, joint_reach, off_shaft_slopes
from design.toolpath.embedded.rules import Meetings, entry_mm, find_meetings, meetings_between
from design.toolpath.embedded.touches import TOUCHING, Touches, arcs_of
from design.toolpath.toolpath import MoveKind, Toolpath
from kernels import jit
from kernels.arrays import FloatArray, IntArray

# With the tip at b(s) on a straight way and the filament's axis at a(t), radius r(t), all linear,
# the approach is g(s, t) = d(a(t) - b(s)) - r(t), d the signed distance to the shaft. The shaft is
# convex, so g is: it lies above its tangent plane in the middle of a rectangle of s and t (Boyd and
# Vandenberghe 2004, Convex Optimization, eq. 3.2), which so bounds the whole rectangle. How far ink
# lies inside a joint changes no faster than the ways along the vessels. Rectangles are halved until
# they hold no nearer approach, lie in a joint, or are `FINE_MM` small.
FINE_MM: Final = 0.001
"""An approach found lies above the least one by no more."""
DEPTH: Final = 96
"""Of the halving's stack, two rows for each of 48 halvings: below a nanometre."""
FOUND: Final = np.dtype([("piece", np.int64), ("vessel", np.int64), ("value", np.float64)])


class Ink(NamedTuple):
    """Pieces of filaments in the order of writing; values (n, 2) are at both ends."""

    start: FloatArray  # (n, 3), mm
    end: FloatArray  # (n, 3), mm
    radius: FloatArray  # (n, 2), mm
    along: FloatArray  # (n, 2), way along its vessel, mm
    share: FloatArray  # (n, 2), of the move that writes it
    vessel: IntArray  # (n,)
    row: IntArray  # (n,), the move


class Tips(NamedTuple):
    """Straight pieces of the tips' motion, and the vessels written or left, and gone to."""

    start: FloatArray  # (n, 3), mm
    end: FloatArray  # (n, 3), mm
    row: IntArray  # (n,), the move
    share: FloatArray  # (n, 2), of it, at both ends
    vessel: IntArray  # (n, 2), -1 for none
    radius: FloatArray  # (n, 2), of these filaments, mm
    along: FloatArray  # (n, 2, 2), way along these vessels at both ends, mm
    since: FloatArray  # (n, 2, 2), way from the pass's end or to its start, mm


@jit
def entries(
    tips: Tips, ink: Ink, squares: Squares, spared: Spared, needle: Needle, look: float
) -> NDArray[np.void]:
    """The nearest approach below ``look`` mm of each piece of way to each vessel, `FOUND`."""
    piece, vessel, value = [0][:0], [0][:0], [0.0][:0]
    stack = np.empty((DEPTH, 4))
    for i in range(len(tips.row)):
        start, end = tips.start[i], tips.end[i]
        middle, lowest = 0.5 * (start + end), min(start[2], end[2]) - look
        room = needle.shaft_mm + look + 0.5 * math.hypot(end[0] - start[0], end[1] - start[1])
        first = len(piece)
        for row in range(3):
            low, high = near(squares, middle, row)
            for m in range(low, high):
                x, y, top, reach = squares.around[m]
                far = (x - middle[0]) ** 2 + (y - middle[1]) ** 2 > (room + reach) ** 2
                j = squares.member[m]
                if far or top < lowest or ink.row[j] > tips.row[i]:
                    continue
                known = -1
                for k in range(first, len(piece)):
                    if vessel[k] == ink.vessel[j]:
                        known = k
                best = value[known] if known >= 0 else look
                nearest = _nearest(i, j, best, tips, ink, spared, needle, stack)
                if nearest >= best:
                    continue
                if known >= 0:
                    value[known] = nearest
                else:
                    piece.append(i)
                    vessel.append(ink.vessel[j])
                    value.append(nearest)
    out = np.empty(len(piece), FOUND)
    for k in range(len(piece)):
        out[k].piece, out[k].vessel, out[k].value = piece[k], vessel[k], value[k]
    return out


@jit
def _approach(
    i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, needle: Needle
) -> tuple[float, float, float]:
    """g(s, t), mm, and how it changes with s and t there (a subgradient)."""
    x = _at(ink.start[j, 0], ink.end[j, 0], t) - _at(tips.start[i, 0], tips.end[i, 0], s)
    y = _at(ink.start[j, 1], ink.end[j, 1], t) - _at(tips.start[i, 1], tips.end[i, 1], s)
    z = _at(ink.start[j, 2], ink.end[j, 2], t) - _at(tips.start[i, 2], tips.end[i, 2], s)
    across = math.sqrt(x * x + y * y)
    off, outward, up = off_shaft_slopes(across, z, needle)
    flat = outward / across if across > 0.0 else 0.0
    by_s, by_t = 0.0, ink.radius[j, 0] - ink.radius[j, 1]
    for axis, slope in enumerate((flat * x, flat * y, up)):
        by_s -= slope * (tips.end[i, axis] - tips.start[i, axis])
        by_t += slope * (ink.end[j, axis] - ink.start[j, axis])
    return off - _at(ink.radius[j, 0], ink.radius[j, 1], t), by_s, by_t


@jit
def _at(low: float, high: float, share: float) -> float:
    return low + share * (high - low)


@jit
def _span(a: FloatArray, b: FloatArray) -> float:
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return math.sqrt(x * x + y * y + z * z)


@jit
def _inside(i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, spared: Spared,
            needle: Needle) -> float:  # fmt: skip
    """How far ink lies inside a joint, or ahead of the tip that writes it, mm."""
    best = -np.inf
    if ink.row[j] == tips.row[i]:
        ahead = _at(ink.share[j, 0], ink.share[j, 1], t) - _at(
            tips.share[i, 0], tips.share[i, 1], s
        )
        part = tips.share[i, 1] - tips.share[i, 0]
        best = ahead / part * _span(tips.start[i], tips.end[i])
    there, other = _at(ink.along[j, 0], ink.along[j, 1], t), ink.vessel[j]
    thick = max(ink.radius[j, 0], ink.radius[j, 1])
    for k in range(2):
        vessel = tips.vessel[i, k]
        if vessel < 0 or tips.since[i, k, 0] == np.inf:
            continue
        reach = reach_of(vessel, tips.radius[i, k], other, thick, spared, needle)
        left = reach - _at(tips.since[i, k, 0], tips.since[i, k, 1], s)
        at = _at(tips.along[i, k, 0], tips.along[i, k, 1], s)
        best = max(best, inside_joint(vessel, at, left, other, there, reach, spared))
    return best


@jit
def _related(i: int, j: int, tips: Tips, ink: Ink, spared: Spared) -> bool:
    """Whether a joint may spare ink at all."""
    if ink.row[j] == tips.row[i]:
        return True
    for k in range(2):
        vessel = tips.vessel[i, k]
        if vessel < 0 or tips.since[i, k, 0] == np.inf:
            continue
        if vessel == ink.vessel[j]:
            return True
        low, high = meetings_between(vessel, ink.vessel[j], spared.meetings)
        if low < high:
            return True
    return False


@jit
def _slope(i: int, tips: Tips) -> float:
    """Most by which `_inside` changes along a piece of way, mm."""
    most = _span(tips.start[i], tips.end[i])
    for k in range(2):
        if tips.since[i, k, 0] < np.inf:
            way = abs(tips.since[i, k, 1] - tips.since[i, k, 0])
            most = max(most, way + abs(tips.along[i, k, 1] - tips.along[i, k, 0]))
    return most


@jit
def _nearest(i: int, j: int, limit: float, tips: Tips, ink: Ink, spared: Spared,
             needle: Needle, stack: FloatArray) -> float:  # fmt: skip
    """Nearest approach of two pieces outside of joints, mm; ``limit`` where none is below it."""
    way, axis = _span(tips.start[i], tips.end[i]), _span(ink.start[j], ink.end[j])
    axis += abs(ink.radius[j, 1] - ink.radius[j, 0])
    related = _related(i, j, tips, ink, spared)
    by_s, by_t = way, axis
    if related:
        by_s = max(by_s, _slope(i, tips))
        by_t = max(by_t, abs(ink.along[j, 1] - ink.along[j, 0]))
    stack[0] = (0.0, 1.0, 0.0, 1.0)
    best, count = limit, 1
    while count > 0:
        count -= 1
        s0, s1, t0, t1 = stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3]
        s, t, half_s, half_t = 0.5 * (s0 + s1), 0.5 * (t0 + t1), 0.5 * (s1 - s0), 0.5 * (t1 - t0)
        value, slope_s, slope_t = _approach(i, j, s, t, tips, ink, needle)
        if value - half_s * abs(slope_s) - half_t * abs(slope_t) >= best - FINE_MM:
            continue
        spread = half_s * by_s + half_t * by_t
        inside = -1.0
        if related:
            inside = _inside(i, j, s, t, tips, ink, spared, needle)
            if inside > spread or (inside > 0.0 and spread <= FINE_MM):
                continue
        if inside <= 0.0:
            best = min(best, value)
        if spread <= 0.25 * FINE_MM:
            continue
        near, far = (
            stack[count + 1],
            stack[count],
        )  # the half on top of the stack is looked at first
        near[:], far[:] = (s0, s1, t0, t1), (s0, s1, t0, t1)
        if half_s * by_s >= half_t * by_t:
            low, high = (near, far) if slope_s > 0.0 else (far, near)
            low[1], high[0] = s, s
        else:
            low, high = (near, far) if slope_t > 0.0 else (far, near)
            low[3], high[2] = t, t
        count += 2
    return best


class Spared(NamedTuple):
    """Where vessels meet, whose ink there counts as the tip's own."""

    meetings: Meetings  # in the vessels' own lengths
    lumen_mm: FloatArray  # (v,), radius of a bundle of strands, by which joints reach; else 0
    length: FloatArray  # (v,), mm


def exempt_lengths(network: VesselNetwork, touches: Touches, lumen_mm: FloatArray) -> Spared:
    """Return the nodes and touches of a network, in the vessels' own lengths."""
    length = arcs_of(network)[1]
    return Spared(find_meetings(network.vessel_nodes, length, touches), lumen_mm, length)


@jit
def reach_of(
    vessel: int, radius: float, other: int, thick: float, spared: Spared, needle: Needle
) -> float:
    """How far the joint of a filament with another one goes, mm."""
    wide = max(radius, thick, spared.lumen_mm[vessel], spared.lumen_mm[other])
    return joint_reach(needle, wide)


@jit
def past_other_end(vessel: int, at: float, end: float, spared: Spared) -> float:
    """How far a place lies past the vessel's other end than ``end``, mm; below 0 before it.

    What lies past an end lies where another vessel is, and belongs to that end's joint alone.
    """
    return -at if end > 0.0 else at - spared.length[vessel]


@jit
def inside_joint(
    vessel: int,
    at: float,
    left: float,
    other: int,
    there: float,
    reach: float,
    spared: Spared,
) -> float:
    """How far inside a joint ink ``there`` along a vessel lies, mm; below 0 it is outside.

    The tip is ``at`` mm along its vessel; ``left`` of the joint's reach is not yet used up by its
    way from or to there.
    """
    best = left - abs(there - at) if vessel == other else -np.inf
    met = spared.meetings
    low, high = meetings_between(vessel, other, met)
    most = left + TOUCHING.cell_mm
    for m in range(low + np.searchsorted(met.own[low:high], at - most), high):
        if met.own[m] > at + most:
            break
        tip = left - abs(met.own[m] - at) - met.gap[m]
        here = min(tip, reach - abs(met.there[m] - there)) + met.wide[m]
        if met.wide[m] == 0.0:
            past = past_other_end(vessel, at, met.own[m], spared)
            past = max(past, past_other_end(other, there, met.there[m], spared))
            here = min(here, ROUNDING_MM - past)
        best = max(best, here)
    return float(best)


INK_MM, TIP_MM = 0.5, 0.2
"""No piece of ink, and of a way of the tip, is longer: halving begins with these."""


class WrittenMoves(NamedTuple):
    """What the moves that write lay, from end to end."""

    vessel: IntArray  # (w,)
    along: FloatArray  # (w, 2), way along the vessel, on beyond its end, mm
    radius: FloatArray  # (w, 2), of the filament, mm


class Entry(NamedTuple):
    """A vessel's ink to which a piece of the path comes too near."""

    move: int  # of the toolpath
    vessel: int  # being written, left or gone to
    through: int  # whose ink it is
    length_mm: float  # of the piece of path
    depth_mm: float  # of the bare shaft in the ink; below 0 it passes at that distance


class _Pieces(NamedTuple):
    """Rows cut up: of each piece its row, and the shares of the row at both ends (k, 2)."""

    row: IntArray
    share: FloatArray


def find_shaft_contacts(
    toolpath: Toolpath,
    laid: WrittenMoves,
    spared: Spared,
    needles: Sequence[Needle],
    look_mm: float,
) -> list[Entry]:
    """Find all entries and all that comes nearer than ``look_mm``, one for each piece and vessel.

    Parameters
    ----------
    toolpath : Toolpath
    laid : WrittenMoves
        Of its moves that write, in their order.
    spared : Spared
    needles : sequence of Needle
        Of each head, bare.
    look_mm : float, mm
    """
    writes = toolpath.kind == MoveKind.WRITE
    ink = _ink(toolpath, np.flatnonzero(writes), laid)
    contacts = []
    for tool, needle in enumerate(needles):
        tips = _tips(toolpath, writes & (toolpath.tool == tool), laid, tool)
        if len(tips.row):
            room = needle.shaft_mm + look_mm + TIP_MM / 2
            squares = sort_stretches(ink.start, ink.end, ink.radius, room)
            hits = entries(tips, ink, squares, spared, needle, look_mm)
            contacts += _entries(hits, tips)
    return contacts


def _cut(length: FloatArray, longest_mm: float) -> _Pieces:
    count = np.maximum(np.ceil(length / longest_mm), 1).astype(np.int64)
    row = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return _Pieces(row, np.column_stack([nth, nth + 1]) / count[row][:, None])


def _mixed(ends: FloatArray, pieces: _Pieces) -> FloatArray:
    """Values at rows' ends (n, 2) or (n, 2, 3) at both ends of each piece; inf stays inf."""
    low, high = ends[pieces.row, 0], ends[pieces.row, 1]
    share = pieces.share if ends.ndim == 2 else pieces.share[:, :, None]
    both = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(both, low, 0.0)[:, None], np.where(both, high, 0.0)[:, None]
    return np.where(both[:, None], low + share * (high - low), np.inf)


def _ink(toolpath: Toolpath, rows: IntArray, laid: WrittenMoves) -> Ink:
    pieces = _cut(toolpath.lengths[rows], INK_MM)
    place = _mixed(np.stack([toolpath.start[rows], toolpath.end[rows]], axis=1), pieces)
    return Ink(
        np.ascontiguousarray(place[:, 0]),
        np.ascontiguousarray(place[:, 1]),
        _mixed(laid.radius, pieces),
        _mixed(laid.along, pieces),
        pieces.share.copy(),
        laid.vessel[pieces.row],
        rows[pieces.row],
    )


def _tips(toolpath: Toolpath, writes: NDArray[np.bool_], laid: WrittenMoves, tool: int) -> Tips:
    """Ways of one head's tip."""
    number = np.cumsum(toolpath.kind == MoveKind.WRITE) - 1
    last, following, since, until = _about(toolpath, writes)
    rows = np.flatnonzero((toolpath.tool == tool) & (toolpath.lengths > 0))
    pieces = _cut(toolpath.lengths[rows], TIP_MM)
    place = _mixed(np.stack([toolpath.start[rows], toolpath.end[rows]], axis=1), pieces)
    own = writes[rows]
    ends = np.stack([last[rows], np.where(own, -1, following[rows])])
    known, of = ends >= 0, number[ends]
    along = np.stack([
        np.repeat(np.where(known[k], laid.along[of[k], 1 - k], 0.0)[:, None], 2, axis=1)
        for k in (0, 1)
    ])  # fmt: skip
    along[0, own] = laid.along[of[0, own]]
    return Tips(
        np.ascontiguousarray(place[:, 0]),
        np.ascontiguousarray(place[:, 1]),
        rows[pieces.row],
        pieces.share.copy(),
        np.where(known, laid.vessel[of], -1).T[pieces.row].copy(),
        np.where(known, laid.radius.max(axis=1)[of], 0.0).T[pieces.row].copy(),
        np.stack([_mixed(one, pieces) for one in along], axis=1),
        np.stack([_mixed(one[rows], pieces) for one in (since, until)], axis=1),
    )


def _about(
    toolpath: Toolpath, writes: NDArray[np.bool_]
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Last written row at or before each, next at or after (-1: none), and ways from and to these.

    A rise out of a pass's end and a descent to a start count by what they go in the plan alone: a
    needle that rises stands in the same ink as before. inf where there is none.
    """
    rows, count = np.arange(len(toolpath)), len(toolpath)
    last = np.maximum.accumulate(np.where(writes, rows, -1))
    following = np.minimum.accumulate(np.where(writes, rows, count)[::-1])[::-1]
    step, length = toolpath.end - toolpath.start, toolpath.lengths
    flat = np.hypot(step[:, 0], step[:, 1])
    up = np.append(0.0, np.cumsum(np.where(writes, 0.0, np.where(step[:, 2] >= 0, flat, length))))
    down = np.append(0.0, np.cumsum(np.where(writes, 0.0, np.where(step[:, 2] <= 0, flat, length))))
    both = np.column_stack([rows, rows + 1])
    since = np.where(last[:, None] >= 0, up[both] - up[last + 1][:, None], np.inf)
    next_row = np.minimum(following, count - 1)
    until = np.where(following[:, None] < count, down[next_row][:, None] - down[both], np.inf)
    following = np.where(following < count, following, -1)
    return last, following, np.maximum(since, 0.0), np.maximum(until, 0.0)


def _entries(hits: NDArray[np.void], tips: Tips) -> list[Entry]:
    piece = hits["piece"]
    length = np.linalg.norm(tips.end[piece] - tips.start[piece], axis=1)
    vessel = tips.vessel[piece]
    rises = (tips.end[piece, 2] > tips.start[piece, 2]) | (vessel[:, 1] < 0)
    own = np.where(rises & (vessel[:, 0] >= 0), vessel[:, 0], vessel[:, 1])
    columns = (tips.row[piece], own, hits["vessel"], length, -hits["value"])
    return [Entry(*one) for one in zip(*(column.tolist() for column in columns), strict=True)]


TOUCH_MM: Final = 0.005
"""Deeper is a crossing, as for the check before a print."""
CERTAIN_MM: Final = TOUCH_MM - ROUNDING_MM
"""No deeper is none, either, once the path is rounded to the digits of its G-code."""


@jit
def entries_mm(
    first: IntArray, after: IntArray, elements: Elements, meetings: Meetings, needle: Needle
) -> FloatArray:
    """`entry_mm` of pairs: into the second of each, (k,), while the first is written."""
    depths = np.empty(len(first))
    for k in range(len(first)):
        depths[k] = entry_mm(first[k], after[k], elements, meetings, needle)
    return depths
