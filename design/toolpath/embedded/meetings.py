"""Find where vessels join others (nodes, touching filaments), exempt from needle shaft rules."""

from __future__ import annotations

from itertools import permutations
from typing import Final, NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.touches import Touches
from kernels import jit
from kernels.arrays import FloatArray, IntArray

SAME_MM: Final = 1e-6


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
    gap : (m,) float64, mm
        From one axis to the other; 0 at a node.
    """

    begin: IntArray
    own: FloatArray
    other: IntArray
    there: FloatArray
    gap: FloatArray


def at_nodes(network: VesselNetwork, elements: Elements) -> Meetings:
    """Each end of a vessel with all others at its node."""
    length = np.add.reduceat(elements.length, elements.first[:-1])
    ends: dict[int, list[tuple[int, float]]] = {}
    for vessel, (tail, head) in enumerate(network.vessel_nodes.tolist()):
        ends.setdefault(tail, []).append((vessel, 0.0))
        ends.setdefault(head, []).append((vessel, float(length[vessel])))
    rows = [(*a, *b, 0.0) for meet in ends.values() for a, b in permutations(meet, 2)]
    return _sorted(np.array(rows, dtype=np.float64).reshape(-1, 5), len(length))


def with_touches(meetings: Meetings, touches: Touches, elements: Elements) -> Meetings:
    """The same, and the places where filaments touch, by their way along the elements."""
    own = np.repeat(np.arange(len(meetings.begin) - 1), np.diff(meetings.begin))
    last = elements.first[1:] - 1
    chords = (elements.arc[last] + elements.length[last]) / elements.along[last, 1]
    (u, v), (a, b) = touches.vessel.T, (touches.arc * chords[touches.vessel]).T
    rows = np.concatenate([
        np.column_stack([own, meetings.own, meetings.other, meetings.there, meetings.gap]),
        np.column_stack([u, a, v, b, touches.gap]),
        np.column_stack([v, b, u, a, touches.gap]),
    ])  # fmt: skip
    return _sorted(rows, len(meetings.begin) - 1)


def _sorted(rows: FloatArray, vessels: int) -> Meetings:
    rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
    count = np.bincount(rows[:, 0].astype(np.int64), minlength=vessels)
    begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    columns = (np.ascontiguousarray(column) for column in rows[:, 1:].T)
    own, other, there, gap = columns
    return Meetings(begin, own, other.astype(np.int64), there, gap)


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
    vessel: int, at: float, j: int, reach: float, elements: Elements, meetings: Meetings,
    far: float = np.inf,
) -> tuple[float, float]:  # fmt: skip
    """Part of element j (0..1) that belongs to no joint of a tip ``at`` mm along a vessel.

    A joint's is what lies within reach of the tip along the same vessel, or of a place where its
    vessel meets the tip's, the tip within reach of that place on either vessel too; but not of the
    vessel's end ``far``, where the tip goes on past the other one.
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
        near = abs(meetings.own[m] - at) + meetings.gap[m] <= reach
        if near and meetings.other[m] == other and abs(meetings.own[m] - far) > SAME_MM:
            low, high = clipped(low, high, meetings.there[m], reach)
    return (low - start) / elements.length[j], (high - start) / elements.length[j]


@jit
def of_one_joint(
    vessel: int, at: float, other: int, there: float, reach: float, meetings: Meetings, far: float,
    far_tip: float = np.inf,
) -> bool:  # fmt: skip
    """Whether two places on vessels belong to one joint, as in `outside_joints`.

    Of a place past its vessel's end the joint at the vessel's other end, ``far``, is none: of the
    ink ``there``, and ``far_tip`` of the tip.
    """
    if vessel == other and abs(at - there) <= reach:
        return True
    for m in range(meetings.begin[vessel], meetings.begin[vessel + 1]):
        if (
            meetings.other[m] == other
            and abs(meetings.there[m] - far) > SAME_MM
            and abs(meetings.own[m] - far_tip) > SAME_MM
            and abs(meetings.own[m] - at) + meetings.gap[m] <= reach
            and abs(meetings.there[m] - there) <= reach
        ):
            return True
    return False
