"""Find pairs of vessel elements to be written in order, so that the shaft enters no ink.

With the tip at b the shaft fills all above b within its radius. An element with its axis at a and
radius r is hit when it lies within shaft and r of b in the plan, and its top is above b. The lower
one goes first, then. Ink that belongs to a joint is spared (`outside_joints`).
"""

from __future__ import annotations

from itertools import permutations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements, Squares, near
from design.toolpath.embedded.needle import (
    Needle,
    joint_reach,
    off_shaft,
    radius_at,
    without_clearance,
)
from design.toolpath.embedded.touches import TOUCHING, Touches
from kernels import jit
from kernels.arrays import FloatArray, IntArray

TIPS: Final = 5
"""Places of the tip along an element. Elements are no longer than the shaft's radius R, so
that a touch between two places is missed by at most R/128, which the clearance covers."""
THIRDS: Final = 10
"""Of a part of an axis dropped in the search for its place nearest to the shaft: to (2/3)^10."""
GRAZE: Final = 0.01
"""Harm where the needle itself passes by, against that of a crossing: where two elements bar each
other, the one that the needle would enter is written later."""


class Rules(NamedTuple):
    """Element ``i`` goes before ``after[begin[i] : begin[i + 1]]``."""

    begin: IntArray  # (n + 1,)
    after: IntArray  # (m,), ascending for each element
    # (m,), mm, were the later one written first: how much of its height the shaft would fill, and a
    # hundredth of that where only the clearance reaches into it.
    harm: FloatArray


def find_rules(elements: Elements, squares: Squares, meetings: Meetings, needle: Needle) -> Rules:
    """All pairs whose order matters; two that say the opposite harm each other in any order."""
    return Rules(*_all_pairs(elements, squares, meetings, needle))


def one_way(rules: Rules, vessel: IntArray) -> Rules:
    """Without the lesser of two rules that say the opposite; ``vessel`` (n,) of each element.

    Between two vessels that bar each other the sum over all such pairs decides: were it each pair
    by itself, the two would have to be written in turns, cut at every change.
    """
    first, vessels = owners(rules), int(vessel.max()) + 1
    back = _places(_keys(rules.after, first, vessel), _keys(first, rules.after, vessel))
    mutual = back >= 0
    one, other = vessel[first[mutual]], vessel[rules.after[mutual]]
    pairs, pair = np.unique(one * vessels + other, return_inverse=True)
    total = np.bincount(pair, weights=rules.harm[mutual])
    own, opposite = total[pair], total[_places(other * vessels + one, pairs)]
    alone = one == other
    own = np.where(alone, rules.harm[mutual], own)
    opposite = np.where(alone, rules.harm[back[mutual]], opposite)
    kept = ~mutual
    kept[mutual] = (own > opposite) | ((own == opposite) & (first < rules.after)[mutual])
    return _rules(first[kept], rules.after[kept], rules.harm[kept], len(vessel))


def owners(rules: Rules) -> IntArray:
    """The element that goes first, of each rule, (m,)."""
    return np.repeat(np.arange(len(rules.begin) - 1), np.diff(rules.begin))


def barring_each_other(rules: Rules) -> NDArray[np.bool_]:
    """Whether another rule says the opposite of each, (m,)."""
    first, count = owners(rules), rules.begin[:-1]
    return _places(_keys(rules.after, first, count), _keys(first, rules.after, count)) >= 0


def either_way(rules: Rules) -> tuple[IntArray, IntArray]:
    """Elements of which either must go before the other, each pair once."""
    rows = np.flatnonzero(barring_each_other(rules))
    first, after = owners(rules)[rows], rules.after[rows]
    once = first < after
    return first[once], after[once]


def select_rules(rules: Rules, rows: NDArray[np.bool_]) -> Rules:
    """Only some of the rules, by a mask (m,)."""
    first = owners(rules)[rows]
    return _rules(first, rules.after[rows], rules.harm[rows], len(rules.begin) - 1)


def with_more(rules: Rules, first: IntArray, after: IntArray) -> Rules:
    """The rules, and that each element of `first` (k,) goes before that of `after` (k,).

    Of those that say the opposite of a rule, or of each other, the rule or the first is kept.
    """
    owner, count = owners(rules), rules.begin[:-1]
    known = _keys(owner, rules.after, count)
    old = _places(_keys(first, after, count), known) >= 0
    old |= _places(_keys(after, first, count), known) >= 0
    kept: dict[tuple[int, int], None] = {}
    for one, other in zip(first[~old].tolist(), after[~old].tolist(), strict=True):
        if (other, one) not in kept:
            kept[one, other] = None
    more = np.array(list(kept), dtype=np.int64).reshape(-1, 2)
    return _rules(
        np.append(owner, more[:, 0]),
        np.append(rules.after, more[:, 1]),
        np.append(rules.harm, np.zeros(len(more))),
        len(count),
    )


def _rules(first: IntArray, after: IntArray, harm: FloatArray, count: int) -> Rules:
    order = np.argsort(first * count + after, kind="stable")
    begin = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=count))])
    return Rules(begin, after[order], harm[order])


def _keys(first: IntArray, after: IntArray, each: IntArray) -> IntArray:
    """One number for each pair of elements, of which `each` has an entry."""
    return first * len(each) + after


def _places(keys: IntArray, known: IntArray) -> IntArray:
    """Where keys are among ascending ones; -1 for those that aren't."""
    if not len(known):
        return np.full(len(keys), -1)
    at = np.searchsorted(known, keys).clip(max=len(known) - 1)
    return np.where(known[at] == keys, at, -1)


@jit
def flat_gap(x: float, y: float, a: FloatArray, b: FloatArray, low: float, high: float) -> float:
    """Distance in the plan from a place to the part ``low`` to ``high`` (0..1) of a stretch."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length2 = dx * dx + dy * dy
    share = ((x - a[0]) * dx + (y - a[1]) * dy) / length2 if length2 > 0.0 else 0.0
    share = min(max(share, low), high)
    return float(np.hypot(a[0] + share * dx - x, a[1] + share * dy - y))


@jit
def depth_at(
    tip: FloatArray, radius: float, vessel: int, at: float, j: int, elements: Elements,
    meetings: Meetings, needle: Needle, far: float = np.inf,
) -> tuple[float, float, float]:  # fmt: skip
    """Depth to which the shaft above a tip reaches into element j, mm, and the part that counts.

    That is the part (0..1) outside joints. The tip writes a filament of `radius`, ``at`` mm along a
    vessel; of one that goes on past an end ``far`` is the other.
    """
    a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
    thick = max(elements.radius[j, 0], elements.radius[j, 1])
    depth = _depth(tip, a, b, thick, 0.0, 1.0, needle)
    if depth <= 0.0:
        return 0.0, 0.0, 1.0
    reach = joint_reach(needle, max(thick, radius))
    low, high = outside_joints(vessel, at, j, reach, elements, meetings, far)
    if low >= high:
        return 0.0, low, high
    if low > 0.0 or high < 1.0:
        depth = _depth(tip, a, b, thick, low, high, needle)
    return depth, low, high


@jit
def _depth(
    tip: FloatArray, a: FloatArray, b: FloatArray, thick: float, low: float, high: float,
    needle: Needle,
) -> float:  # fmt: skip
    """How deep the shaft, clearance included, reaches into a part of a filament, mm; 0 for not."""
    height = max(a[2] + low * (b[2] - a[2]), a[2] + high * (b[2] - a[2])) + thick - tip[2]
    if height <= 0.0:
        return 0.0
    room = radius_at(needle, height) + thick - flat_gap(tip[0], tip[1], a, b, low, high)
    if room <= 0.0:
        return 0.0
    return max(thick - off_part(tip, a, b, low, high, needle), 0.0)


@jit
def tip_along(i: int, k: int, elements: Elements) -> tuple[FloatArray, float]:
    """The ``k``-th of `TIPS` places of the tip along an element, and its way along the vessel."""
    share = k / (TIPS - 1.0)
    tail, head = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
    return tail + share * (head - tail), elements.arc[i] + share * elements.length[i]


@jit
def entry_mm(i: int, j: int, elements: Elements, meetings: Meetings, needle: Needle) -> float:
    """Depth of the shaft in element j, outside joints, while i is written, mm; 0 for none."""
    radius, most = max(elements.radius[i, 0], elements.radius[i, 1]), 0.0
    for k in range(TIPS):
        tip, at = tip_along(i, k, elements)
        vessel = elements.vessel[i]
        most = max(most, depth_at(tip, radius, vessel, at, j, elements, meetings, needle)[0])
    return most


@jit
def _harm(i: int, j: int, elements: Elements, meetings: Meetings, needle: Needle) -> float:
    """How much of the height of element j the shaft fills while i is written, mm; 0 for none.

    A hundredth of that where the clearance alone reaches into it.
    """
    a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
    thick = max(elements.radius[j, 0], elements.radius[j, 1])
    radius, most = max(elements.radius[i, 0], elements.radius[i, 1]), 0.0
    for k in range(TIPS):
        if most >= 2.0 * thick:
            break
        tip, at = tip_along(i, k, elements)
        depth, low, high = depth_at(
            tip, radius, elements.vessel[i], at, j, elements, meetings, needle
        )
        if depth <= 0.0:
            continue
        top = max(a[2] + low * (b[2] - a[2]), a[2] + high * (b[2] - a[2])) + thick
        filled = min(top - tip[2], 2.0 * thick)
        if depth < 2.0 * (needle.tip_mm - needle.bare_mm):  # else the bare needle is in it, too
            depth = thick - off_part(tip, a, b, low, high, without_clearance(needle))
        most = max(most, filled if depth > 0.0 else GRAZE * filled)
    return most


@jit
def off_part(
    tip: FloatArray, a: FloatArray, b: FloatArray, low: float, high: float, needle: Needle
) -> float:
    """Least distance of a part of an axis to the shaft, mm; below 0 inside, as deep as across.

    The shaft is convex, so its distance along a straight line has one least value: thirds of the
    part are dropped until `THIRDS` are.
    """
    if min(a[2] + low * (b[2] - a[2]), a[2] + high * (b[2] - a[2])) >= tip[2] and (
        needle.cone_mm == 0.0
    ):
        return flat_gap(tip[0], tip[1], a, b, low, high) - needle.shaft_mm
    for _ in range(THIRDS):
        third = (high - low) / 3.0
        one = _off_at(tip, a, b, low + third, needle)
        other = _off_at(tip, a, b, high - third, needle)
        if one < other:
            high -= third
        else:
            low += third
    return _off_at(tip, a, b, 0.5 * (low + high), needle)


@jit
def _off_at(tip: FloatArray, a: FloatArray, b: FloatArray, t: float, needle: Needle) -> float:
    x, y = a[0] + t * (b[0] - a[0]) - tip[0], a[1] + t * (b[1] - a[1]) - tip[1]
    return off_shaft(np.sqrt(x * x + y * y), a[2] + t * (b[2] - a[2]) - tip[2], needle)


@jit
def _all_pairs(
    elements: Elements, squares: Squares, meetings: Meetings, needle: Needle
) -> tuple[IntArray, IntArray, FloatArray]:
    count = len(elements.end)
    begin = np.zeros(count + 1, dtype=np.int64)
    size = 32 * count + 64
    after, depth = np.empty(size, dtype=np.int64), np.empty(size)
    total = 0
    for i in range(count):
        p, q = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
        middle = 0.5 * (p + q)
        lowest, room = min(p[2], q[2]), needle.shaft_mm + 0.5 * elements.length[i]
        for k in range(3):
            low, high = near(squares, middle, k)
            for m in range(low, high):
                x, y, top, reach = squares.around[m]
                if (
                    top <= lowest
                    or (x - middle[0]) ** 2 + (y - middle[1]) ** 2 >= (room + reach) ** 2
                ):
                    continue
                j = squares.member[m]
                if j == i:
                    continue
                harm = _harm(i, j, elements, meetings, needle)
                if harm > 0.0:
                    if total == size:
                        size *= 2
                        longer, deeper = np.empty(size, dtype=np.int64), np.empty(size)
                        longer[:total], deeper[:total] = after, depth
                        after, depth = longer, deeper
                    after[total], depth[total] = j, harm
                    total += 1
        order = np.argsort(after[begin[i] : total])
        after[begin[i] : total] = after[begin[i] : total][order]
        depth[begin[i] : total] = depth[begin[i] : total][order]
        begin[i + 1] = total
    return begin, after[:total].copy(), depth[:total].copy()


SAME_MM: Final = 1e-6
"""Places of one joint differ by no more along a vessel."""


class Meetings(NamedTuple):
    """Places of each vessel where it meets one, those of ``v`` in ``begin[v]:begin[v + 1]``."""

    begin: IntArray  # (v + 1,)
    other: IntArray  # (m,), the vessel met, ascending for each; the same where it meets itself
    own: FloatArray  # (m,), way along the vessel, ascending for each other, mm
    there: FloatArray  # (m,), way along that one, mm
    wide: FloatArray  # (m,), how far the place reaches to either side, mm; 0 for a node
    gap: FloatArray  # (m,), from one axis to the other, mm; 0 at a node


def find_meetings(ends: IntArray, length: FloatArray, touches: Touches) -> Meetings:
    """Return each end of a vessel with all others at its node, and the places of touches.

    Parameters
    ----------
    ends : (v, 2) int64
        Nodes of each vessel.
    length : (v,) float64, mm
    touches : Touches
        By ways along vessels of these lengths.
    """
    met: dict[int, list[tuple[int, float]]] = {}
    for vessel, (tail, head) in enumerate(ends.tolist()):
        met.setdefault(tail, []).append((vessel, 0.0))
        met.setdefault(head, []).append((vessel, float(length[vessel])))
    nodes = [
        (v, w, a, b, 0.0, 0.0) for at in met.values() for (v, a), (w, b) in permutations(at, 2)
    ]
    (u, v), (a, b) = touches.vessel.T, touches.arc.T
    wide = np.full(len(u), TOUCHING.cell_mm / 2)
    rows = np.concatenate([
        np.array(nodes, dtype=np.float64).reshape(-1, 6),
        np.column_stack([u, v, a, b, wide, touches.gap]),
        np.column_stack([v, u, b, a, wide, touches.gap]),
    ])  # fmt: skip
    rows = rows[np.lexsort((rows[:, 2], rows[:, 1], rows[:, 0]))]
    count = np.bincount(rows[:, 0].astype(np.int64), minlength=len(ends))
    begin = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    columns = (np.ascontiguousarray(column) for column in rows[:, 2:].T)
    return Meetings(begin, rows[:, 1].astype(np.int64), *columns)


def along_elements(touches: Touches, elements: Elements) -> Touches:
    """Return touches by their ways along the elements: curves are a little longer than these."""
    last = elements.first[1:] - 1
    chords = (elements.arc[last] + elements.length[last]) / elements.along[last, 1]
    return touches._replace(arc=touches.arc * chords[touches.vessel])


@jit
def meetings_between(vessel: int, other: int, meetings: Meetings) -> tuple[int, int]:
    """Range of the places where two vessels meet."""
    begin, end = meetings.begin[vessel], meetings.begin[vessel + 1]
    low = begin + np.searchsorted(meetings.other[begin:end], other)
    return low, begin + np.searchsorted(meetings.other[begin:end], other + 1)


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
    begin, end = meetings_between(vessel, other, meetings)
    first = begin + np.searchsorted(meetings.own[begin:end], at - reach)
    for m in range(first, end):
        if meetings.own[m] > at + reach or low >= high:
            break
        near = abs(meetings.own[m] - at) + meetings.gap[m] <= reach
        if near and abs(meetings.own[m] - far) > SAME_MM:
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
    low, high = meetings_between(vessel, other, meetings)
    for m in range(low, high):
        if (
            abs(meetings.there[m] - far) > SAME_MM
            and abs(meetings.own[m] - far_tip) > SAME_MM
            and abs(meetings.own[m] - at) + meetings.gap[m] <= reach
            and abs(meetings.there[m] - there) <= reach
        ):
            return True
    return False
