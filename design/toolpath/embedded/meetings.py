"""Meetings of vessels: nodes, and touching filaments; ink near both is a joint's."""

from __future__ import annotations

from itertools import permutations
from typing import NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.needle import Needle, joint_reach
from design.toolpath.embedded.squares import Squares, near
from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit

BESIDE = 0.7
"""Filaments touch where they are nearer than this part of the way along vessels: what lies ahead
on a thick vessel is near, too, but no collision."""

BORDER_MM = 0.05
"""Filaments that part so near to a joint's border are no place for a needle."""

DEEP = 0.25
"""Filaments are one body where they reach so far into each other, in radii of the thinner one.
Where they only brush each other the order still matters."""


class Meetings(NamedTuple):
    """Places of each vessel where it meets one, those of ``v`` in ``begin[v]:begin[v + 1]``.

    Attributes
    ----------
    begin : (v + 1,) int64
    own : (m,) float64, mm
        Way along the vessel to the place.
    other : (m,) int64
        The vessel met; the same one where it meets itself.
    there : (m,) float64, mm
        Way along that one.
    """

    begin: IntArray
    own: FloatArray
    other: IntArray
    there: FloatArray


class Touches(NamedTuple):
    """Places where filaments of vessels overlap away from their nodes: a network's own collisions.

    Attributes
    ----------
    vessel : (k, 2) int64
    arc : (k, 2) float64, mm
        Way along either vessel.
    overlap : (k,) float64, mm
        By which the two reach into each other.
    """

    vessel: IntArray
    arc: FloatArray
    overlap: FloatArray


def at_nodes(network: VesselNetwork, elements: Elements) -> Meetings:
    """Each end of a vessel with all others at its node."""
    length = np.add.reduceat(elements.length, elements.first[:-1])
    ends: dict[int, list[tuple[int, float]]] = {}
    for vessel, (tail, head) in enumerate(network.vessel_nodes.tolist()):
        ends.setdefault(tail, []).append((vessel, 0.0))
        ends.setdefault(head, []).append((vessel, float(length[vessel])))
    rows = [(*a, *b) for meet in ends.values() for a, b in permutations(meet, 2)]
    return _sorted(np.array(rows, dtype=np.float64).reshape(-1, 4), len(length))


def with_touches(meetings: Meetings, touches: Touches) -> Meetings:
    """The same, and the places where filaments touch."""
    own = np.repeat(np.arange(len(meetings.begin) - 1), np.diff(meetings.begin))
    (u, v), (a, b) = touches.vessel.T, touches.arc.T
    rows = np.concatenate([
        np.column_stack([own, meetings.own, meetings.other, meetings.there]),
        np.column_stack([u, a, v, b]),
        np.column_stack([v, b, u, a]),
    ])  # fmt: skip
    return _sorted(rows, len(meetings.begin) - 1)


def _sorted(rows: FloatArray, vessels: int) -> Meetings:
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    count = np.bincount(rows[:, 0].astype(np.int64), minlength=vessels)
    begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    columns = (np.ascontiguousarray(column) for column in rows[:, 1:].T)
    own, other, there = columns
    return Meetings(begin, own, other.astype(np.int64), there)


def touches(elements: Elements, squares: Squares, meetings: Meetings, needle: Needle) -> Touches:
    """Where filaments overlap further from their common nodes than a joint reaches.

    What overlaps is one body when both are written, whichever comes first; the shaft passes through
    it there as through a joint. Whether the design means it is the designer's to say.
    """
    one, other, gap = _overlapping(elements, squares, meetings, needle)
    thick = elements.radius.max(axis=1)
    pair = np.column_stack([one, other])
    arc = elements.arc[pair] + elements.length[pair] / 2
    return Touches(elements.vessel[pair], arc, thick[one] + thick[other] - gap)


@jit
def clipped(low: float, high: float, place: float, reach: float) -> tuple[float, float]:
    """What is left of a short way ``low`` to ``high`` without what lies within reach of a place."""
    if place - reach <= low and high <= place + reach:
        return high, high
    if place - reach <= low < place + reach:
        return place + reach, high
    if low < place - reach < high:
        return low, place - reach
    return low, high


@jit
def outside_joints(
    vessel: int, at: float, j: int, reach: float, elements: Elements, meetings: Meetings
) -> tuple[float, float]:
    """Part of element j (0..1) that belongs to no joint of a tip ``at`` mm along a vessel.

    A joint's is what lies within reach of the tip along the same vessel, or of a place where its
    vessel meets the tip's, the tip within reach of that place too.
    """
    other, start = elements.vessel[j], elements.arc[j]
    low, high = start, start + elements.length[j]
    if other == vessel:
        low, high = clipped(low, high, at, reach)
    begin, end = meetings.begin[vessel], meetings.begin[vessel + 1]
    first = begin + np.searchsorted(meetings.own[begin:end], at - reach)
    for m in range(first, end):
        if meetings.own[m] > at + reach or low >= high:
            break
        if meetings.other[m] == other:
            low, high = clipped(low, high, meetings.there[m], reach)
    return (low - start) / elements.length[j], (high - start) / elements.length[j]


@jit
def of_one_joint(
    vessel: int, at: float, other: int, there: float, reach: float, meetings: Meetings
) -> bool:
    """Whether two places on vessels belong to one joint, as in `outside_joints`."""
    if vessel == other and abs(at - there) <= reach:
        return True
    for m in range(meetings.begin[vessel], meetings.begin[vessel + 1]):
        if meetings.other[m] == other and (
            abs(meetings.own[m] - at) <= reach and abs(meetings.there[m] - there) <= reach
        ):
            return True
    return False


@jit
def _apart(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray, far: float) -> float:
    """Least distance of ends and middles of two short stretches, mm; inf where beyond `far`."""
    x, y, z = a[0] + b[0] - c[0] - d[0], a[1] + b[1] - c[1] - d[1], a[2] + b[2] - c[2] - d[2]
    if 0.25 * (x * x + y * y + z * z) > far * far:  # between the middles
        return np.inf
    least = np.inf
    for k in range(3):
        s = 0.5 * k
        for n in range(3):
            t, away = 0.5 * n, 0.0
            for axis in range(3):
                away += (a[axis] + s * (b[axis] - a[axis]) - c[axis] - t * (d[axis] - c[axis])) ** 2
            least = min(least, away)
    return float(np.sqrt(least))


@jit
def _way(vessel: int, at: float, other: int, there: float, meetings: Meetings) -> float:
    """Way along vessels between two places, through a node at most; inf where there is none."""
    way = abs(at - there) if vessel == other else np.inf
    for m in range(meetings.begin[vessel], meetings.begin[vessel + 1]):
        if meetings.other[m] == other:
            way = min(way, abs(meetings.own[m] - at) + abs(meetings.there[m] - there))
    return float(way)


@jit
def _overlapping(
    elements: Elements, squares: Squares, meetings: Meetings, needle: Needle
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of elements whose filaments overlap, and how far apart their axes are."""
    one, other, gap = [0][:0], [0][:0], [0.0][:0]
    for i in range(len(elements.end)):
        a, b = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
        middle = 0.5 * (a + b)
        radius = max(elements.radius[i, 0], elements.radius[i, 1])
        at = elements.arc[i] + 0.5 * elements.length[i]
        lowest, room = min(a[2], b[2]) - radius, radius + 0.5 * elements.length[i]
        for k in range(3):
            begin, end = near(squares, middle, k)
            for m in range(begin, end):
                x, y, top, reach = squares.around[m]
                if (
                    top < lowest
                    or (x - middle[0]) ** 2 + (y - middle[1]) ** 2 > (room + reach) ** 2
                ):
                    continue
                j = squares.member[m]
                if j <= i:
                    continue
                c, d = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
                thick = max(elements.radius[j, 0], elements.radius[j, 1])
                span = 0.5 * (elements.length[i] + elements.length[j])
                away = _apart(a, b, c, d, radius + thick + span)
                if away >= radius + thick - DEEP * min(radius, thick):
                    continue
                reach = joint_reach(needle, max(radius, thick))
                low, high = outside_joints(elements.vessel[i], at, j, reach, elements, meetings)
                if low > 0.0 or high < 1.0:  # what overlaps within a joint is none of its own
                    low, high = outside_joints(
                        elements.vessel[i], at, j, reach - BORDER_MM, elements, meetings
                    )
                    away = _apart(
                        a, b, c + low * (d - c), c + high * (d - c), radius + thick + span
                    )
                    if away >= radius + thick - DEEP * min(radius, thick):
                        continue
                there = elements.arc[j] + 0.5 * elements.length[j]
                way = _way(elements.vessel[i], at, elements.vessel[j], there, meetings)
                if low < high and away < BESIDE * way:
                    one.append(i)
                    other.append(j)
                    gap.append(away)
    return np.array(one, np.int64), np.array(other, np.int64), np.array(gap, np.float64)
