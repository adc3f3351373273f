"""Least distance of the moving needle shaft to written ink, except where vessels join (compiled).

With the tip at b(s) on a straight way and the filament's axis at a(t), radius r(t), all linear, the
approach is g(s, t) = d(a(t) - b(s)) - r(t), d the signed distance to the shaft. The shaft is
convex, so g is: it lies above its tangent plane in the middle of a rectangle of s and t (Boyd and
Vandenberghe 2004, Convex Optimization, eq. 3.2), which so bounds the whole rectangle. How far ink
lies inside a joint changes no faster than the ways along the vessels. Rectangles are halved until
they hold no nearer approach, lie in a joint, or are `FINE_MM` small.
"""

from __future__ import annotations

import math
from itertools import permutations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from design.toolpath.embedded.needle import Needle, joint_reach, off_shaft_slopes
from design.toolpath.embedded.touches import CELL_MM, Touches, arcs_of
from kernels import jit
from kernels.arrays import FloatArray, IntArray

FINE_MM: Final = 0.001
"""An approach found lies above the least one by no more."""
DEPTH: Final = 96
FOUND: Final = np.dtype([("piece", np.int64), ("vessel", np.int64), ("value", np.float64)])


class Ink(NamedTuple):
    """Pieces of filaments in the order of writing.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius, along : (n, 2) float64, mm
        At both ends: the filament's, and way along its vessel.
    share : (n, 2) float64
        Of the move that writes it, at both ends.
    vessel, row : (n,) int64
        And the move.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray
    along: FloatArray
    share: FloatArray
    vessel: IntArray
    row: IntArray


class Tips(NamedTuple):
    """Straight pieces of the tips' motion.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    row : (n,) int64
        Move.
    share : (n, 2) float64
        Of it, at both ends.
    vessel : (n, 2) int64
        Written or left, and gone to; -1 for none.
    radius : (n, 2) float64, mm
        Of these filaments.
    along, since : (n, 2, 2) float64, mm
        Of these at both ends: way along the vessel, and way from the pass's end or to its start.
    """

    start: FloatArray
    end: FloatArray
    row: IntArray
    share: FloatArray
    vessel: IntArray
    radius: FloatArray
    along: FloatArray
    since: FloatArray


class InkSquares(NamedTuple):
    """Ink by squares of the plan, those of square s in ``member[begin[s]:begin[s + 1]]``."""

    origin: FloatArray
    pitch: float
    shape: IntArray
    begin: IntArray
    member: IntArray


@jit
def entries(
    tips: Tips, ink: Ink, squares: InkSquares, spared: MeetingVessels, needle: Needle, look: float
) -> NDArray[np.void]:
    """The nearest approach below ``look`` mm of each piece of way to each vessel, `FOUND`."""
    piece, vessel, value = [0][:0], [0][:0], [0.0][:0]
    stack = np.empty((DEPTH, 4))
    for i in range(len(tips.row)):
        x = 0.5 * (tips.start[i, 0] + tips.end[i, 0])
        y = 0.5 * (tips.start[i, 1] + tips.end[i, 1])
        column = int(np.floor((x - squares.origin[0]) / squares.pitch))
        row = int(np.floor((y - squares.origin[1]) / squares.pitch))
        low_y, high_y = max(0, row - 1), min(squares.shape[1], row + 2)
        first = len(piece)
        for square in range(max(0, column - 1), min(squares.shape[0], column + 2)):
            if low_y >= high_y:
                break
            begin = squares.begin[square * squares.shape[1] + low_y]
            end = squares.begin[square * squares.shape[1] + high_y]
            for m in range(begin, end):
                j = squares.member[m]
                if ink.row[j] > tips.row[i] or _far(i, j, x, y, tips, ink, needle, look):
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
def _far(
    i: int, j: int, x: float, y: float, tips: Tips, ink: Ink, needle: Needle, look: float
) -> bool:
    """Whether no place of two pieces can be near."""
    thick = max(ink.radius[j, 0], ink.radius[j, 1])
    if max(ink.start[j, 2], ink.end[j, 2]) + thick + look < min(tips.start[i, 2], tips.end[i, 2]):
        return True
    dx, dy = (
        0.5 * (ink.start[j, 0] + ink.end[j, 0]) - x,
        0.5 * (ink.start[j, 1] + ink.end[j, 1]) - y,
    )
    room = needle.shaft_mm + thick + look
    room += 0.5 * math.hypot(ink.end[j, 0] - ink.start[j, 0], ink.end[j, 1] - ink.start[j, 1])
    room += 0.5 * math.hypot(tips.end[i, 0] - tips.start[i, 0], tips.end[i, 1] - tips.start[i, 1])
    return dx * dx + dy * dy > room * room


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
def _inside(i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, spared: MeetingVessels,
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
def _related(i: int, j: int, tips: Tips, ink: Ink, spared: MeetingVessels) -> bool:
    """Whether a joint may spare ink at all."""
    if ink.row[j] == tips.row[i]:
        return True
    for k in range(2):
        vessel = tips.vessel[i, k]
        if vessel < 0 or tips.since[i, k, 0] == np.inf:
            continue
        if vessel == ink.vessel[j]:
            return True
        low, high = meetings_between(vessel, ink.vessel[j], spared)
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
def _nearest(i: int, j: int, limit: float, tips: Tips, ink: Ink, spared: MeetingVessels,
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


# Compute the length of ink at vessel joints that the needle shaft check leaves out.

PAST_MM: Final = 0.002
"""Rounding of a place at a vessel's end."""


class MeetingVessels(NamedTuple):
    """Where vessels meet, those of vessel ``v`` in ``begin[v]:begin[v + 1]``.

    Attributes
    ----------
    begin : (v + 1,) int64
    other : (m,) int64
        The vessel met, ascending for each vessel.
    own, there : (m,) float64, mm
        Way along the vessel, ascending for each other, and along that one.
    wide : (m,) float64, mm
        How far the place reaches to either side: 0 for a node.
    gap : (m,) float64, mm
        From one axis to the other: 0 for a node.
    lumen_mm : (v,) float64, mm
        Radius of a vessel that is a bundle of strands, by which its joints reach; 0 for others.
    length : (v,) float64, mm
    """

    begin: IntArray
    other: IntArray
    own: FloatArray
    there: FloatArray
    wide: FloatArray
    gap: FloatArray
    lumen_mm: FloatArray
    length: FloatArray


def exempt_lengths(
    network: VesselNetwork, touches: Touches, lumen_mm: FloatArray
) -> MeetingVessels:
    """Nodes and touches of a network, in the vessels' own lengths."""
    length = arcs_of(network)[1]
    ends: dict[int, list[tuple[int, float]]] = {}
    for vessel, (tail, head) in enumerate(network.vessel_nodes.tolist()):
        ends.setdefault(tail, []).append((vessel, 0.0))
        ends.setdefault(head, []).append((vessel, float(length[vessel])))
    nodes = [
        (v, w, a, b, 0.0, 0.0) for met in ends.values() for (v, a), (w, b) in permutations(met, 2)
    ]
    (u, v), (a, b) = touches.vessel.T, touches.arc.T
    wide = np.full(len(u), CELL_MM / 2)
    rows = np.concatenate([
        np.array(nodes, dtype=np.float64).reshape(-1, 6),
        np.column_stack([u, v, a, b, wide, touches.gap]),
        np.column_stack([v, u, b, a, wide, touches.gap]),
    ])  # fmt: skip
    rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    count = np.bincount(rows[:, 0].astype(np.int64), minlength=network.vessel_count)
    begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    own, there, wide, gap = (np.ascontiguousarray(column) for column in rows[:, 2:].T)
    return MeetingVessels(
        begin, rows[:, 1].astype(np.int64), own, there, wide, gap, lumen_mm, length
    )


@jit
def reach_of(
    vessel: int, radius: float, other: int, thick: float, spared: MeetingVessels, needle: Needle
) -> float:
    """How far the joint of a filament with another one goes, mm."""
    wide = max(radius, thick, spared.lumen_mm[vessel], spared.lumen_mm[other])
    return joint_reach(needle, wide)


@jit
def meetings_between(vessel: int, other: int, spared: MeetingVessels) -> tuple[int, int]:
    """Range of the places where two vessels meet."""
    begin, end = spared.begin[vessel], spared.begin[vessel + 1]
    low = begin + np.searchsorted(spared.other[begin:end], other)
    return low, begin + np.searchsorted(spared.other[begin:end], other + 1)


@jit
def past_other_end(vessel: int, at: float, end: float, spared: MeetingVessels) -> float:
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
    spared: MeetingVessels,
) -> float:
    """How far inside a joint ink ``there`` along a vessel lies, mm; below 0 it is outside.

    The tip is ``at`` mm along its vessel; ``left`` of the joint's reach is not yet used up by its
    way from or to there.
    """
    best = left - abs(there - at) if vessel == other else -np.inf
    low, high = meetings_between(vessel, other, spared)
    most = left + CELL_MM
    for m in range(low + np.searchsorted(spared.own[low:high], at - most), high):
        if spared.own[m] > at + most:
            break
        tip = left - abs(spared.own[m] - at) - spared.gap[m]
        here = min(tip, reach - abs(spared.there[m] - there)) + spared.wide[m]
        if spared.wide[m] == 0.0:
            past = past_other_end(vessel, at, spared.own[m], spared)
            past = max(past, past_other_end(other, there, spared.there[m], spared))
            here = min(here, PAST_MM - past)
        best = max(best, here)
    return float(best)
