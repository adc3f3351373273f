"""Which element must be written before which: what the shaft would pass through otherwise.

With the tip at b the shaft fills all above b within its radius. An element with its axis at a and
radius r is hit when it lies within shaft and r of b in the plan, and its top is above b. The lower
one goes first, then. Ink that belongs to a joint is spared (`meetings.outside_joints`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.meetings import Meetings, outside_joints
from design.toolpath.embedded.needle import Needle, joint_reach, radius_at
from design.toolpath.embedded.squares import Squares, near
from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit

TIPS = 3
"""Places of the tip along an element. Elements are no longer than half the shaft's radius R, so
that a touch between two places is missed by at most R/128, which the clearance covers."""


class Rules(NamedTuple):
    """Element ``i`` goes before ``after[begin[i] : begin[i + 1]]``.

    Attributes
    ----------
    begin : (n + 1,) int64
    after : (m,) int64
        Ascending for each element.
    depth : (m,) float64, mm
        How much of the later one's height the shaft would fill, were it written first.
    """

    begin: IntArray
    after: IntArray
    depth: FloatArray


def find_rules(elements: Elements, squares: Squares, meetings: Meetings, needle: Needle) -> Rules:
    """All pairs whose order matters; two that say the opposite harm each other in any order."""
    return Rules(*_all_pairs(elements, squares, meetings, needle))


def one_way(rules: Rules) -> Rules:
    """Without the lesser of two rules that say the opposite."""
    return Rules(*_one_way(*rules))


def with_more(rules: Rules, first: IntArray, after: IntArray) -> Rules:
    """The rules, and that each element of `first` (k,) goes before that of `after` (k,)."""
    count = len(rules.begin) - 1
    one = np.concatenate([np.repeat(np.arange(count), np.diff(rules.begin)), first])
    other = np.concatenate([rules.after, after])
    depth = np.concatenate([rules.depth, np.zeros(len(first))])
    _, kept = np.unique(one * count + other, return_index=True)
    begin = np.concatenate([[0], np.cumsum(np.bincount(one[kept], minlength=count))])
    return Rules(begin, other[kept], depth[kept])


def entered(
    first: IntArray, after: IntArray, elements: Elements, meetings: Meetings, needle: Needle
) -> NDArray[np.bool_]:
    """Which of these pairs (k,) the needle itself enters, its clearance apart."""
    bare = needle.bare()
    depth = (_pair_depth(i, j, elements, meetings, bare) for i, j in zip(first, after, strict=True))
    return np.fromiter(depth, dtype=np.float64, count=len(first)) > 0.0


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
    tip: FloatArray,
    radius: float,
    vessel: int,
    at: float,
    j: int,
    elements: Elements,
    meetings: Meetings,
    needle: Needle,
) -> float:
    """How much of element j's height the shaft fills above a tip, joints spared, mm; 0 for none.

    The tip writes a filament of `radius`, ``at`` mm along a vessel.
    """
    a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
    thick = max(elements.radius[j, 0], elements.radius[j, 1])
    height = max(a[2], b[2]) + thick - tip[2]
    wide = radius_at(needle, height) + thick
    if height <= 0.0 or flat_gap(tip[0], tip[1], a, b, 0.0, 1.0) >= wide:
        return 0.0
    reach = joint_reach(needle, max(thick, radius))
    low, high = outside_joints(vessel, at, j, reach, elements, meetings)
    if low >= high:
        return 0.0
    if low > 0.0 or high < 1.0:
        top = max(a[2] + low * (b[2] - a[2]), a[2] + high * (b[2] - a[2])) + thick
        height = top - tip[2]
        wide = radius_at(needle, height) + thick
        if height <= 0.0 or flat_gap(tip[0], tip[1], a, b, low, high) >= wide:
            return 0.0
    return float(min(height, 2.0 * thick))


@jit
def _pair_depth(i: int, j: int, elements: Elements, meetings: Meetings, needle: Needle) -> float:
    """Most of element j's height that the shaft fills while i is written, mm."""
    tail, head = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
    radius = max(elements.radius[i, 0], elements.radius[i, 1])
    most = 0.0
    for k in range(TIPS):
        share = k / (TIPS - 1.0)
        tip = tail + share * (head - tail)
        at = elements.arc[i] + share * elements.length[i]
        vessel = elements.vessel[i]
        most = max(most, depth_at(tip, radius, vessel, at, j, elements, meetings, needle))
    return most


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
                harm = _pair_depth(i, j, elements, meetings, needle)
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


@jit
def _one_way(
    begin: IntArray, after: IntArray, depth: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Without the lesser of two rules that say the opposite; of equal ones the later goes."""
    count = len(begin) - 1
    kept = np.ones(len(after), dtype=np.bool_)
    for i in range(count):
        for k in range(begin[i], begin[i + 1]):
            j = after[k]
            back = begin[j] + np.searchsorted(after[begin[j] : begin[j + 1]], i)
            if back < begin[j + 1] and after[back] == i:
                kept[k] = depth[k] > depth[back] or (depth[k] == depth[back] and i < j)
    fewer = np.zeros(count + 1, dtype=np.int64)
    for i in range(count):
        fewer[i + 1] = fewer[i] + kept[begin[i] : begin[i + 1]].sum()
    return fewer, after[kept], depth[kept]
