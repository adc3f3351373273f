"""Compute how far the needle's shaft enters one vessel's ink while it writes another."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.meetings import Meetings, outside_joints
from design.toolpath.embedded.needle import Needle, joint_reach
from design.toolpath.embedded.rules import TIPS, off_part
from kernels import jit
from kernels.arrays import FloatArray, IntArray

TOUCH_MM: Final = 0.005
"""Deeper is a crossing, as for the check before a print."""
CERTAIN_MM: Final = TOUCH_MM - 0.002
"""No deeper is none, either, once the path is rounded to the digits of its G-code."""


@jit
def entry_mm(i: int, j: int, elements: Elements, meetings: Meetings, needle: Needle) -> float:
    """Depth of the shaft in element j, outside joints, while i is written, mm; 0 for none."""
    tail, head = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
    a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
    thick = max(elements.radius[j, 0], elements.radius[j, 1])
    wide = max(thick, max(elements.radius[i, 0], elements.radius[i, 1]))
    reach, most = joint_reach(needle, wide), 0.0
    for k in range(TIPS):
        share = k / (TIPS - 1.0)
        tip = tail + share * (head - tail)
        if thick - off_part(tip, a, b, 0.0, 1.0, needle) <= most:
            continue
        at = elements.arc[i] + share * elements.length[i]
        low, high = outside_joints(elements.vessel[i], at, j, reach, elements, meetings)
        if low < high:
            most = max(most, thick - off_part(tip, a, b, low, high, needle))
    return most


@jit
def entries_mm(
    first: IntArray, after: IntArray, elements: Elements, meetings: Meetings, needle: Needle
) -> FloatArray:
    """`entry_mm` of pairs: into the second of each, (k,), while the first is written."""
    depths = np.empty(len(first))
    for k in range(len(first)):
        depths[k] = entry_mm(first[k], after[k], elements, meetings, needle)
    return depths


@jit
def near_pairs(v: int, w: int, elements: Elements, needle: Needle) -> IntArray:
    """Elements of two vessels (k, 2) that the needle may touch together, each pair once."""
    pairs = [(0, 0)][:0]
    thick, longest = 0.0, 0.0
    for vessel in (v, w):
        for i in range(elements.first[vessel], elements.first[vessel + 1]):
            thick = max(thick, max(elements.radius[i, 0], elements.radius[i, 1]))
            longest = max(longest, elements.length[i])
    room = needle.shaft_mm + thick + longest
    for i in range(elements.first[v], elements.first[v + 1]):
        p, q = elements.point[elements.end[i, 0]], elements.point[elements.end[i, 1]]
        for j in range(elements.first[w], elements.first[w + 1]):
            a, b = elements.point[elements.end[j, 0]], elements.point[elements.end[j, 1]]
            x, y = 0.5 * (p[0] + q[0] - a[0] - b[0]), 0.5 * (p[1] + q[1] - a[1] - b[1])
            if x * x + y * y < room * room and (v != w or i < j):
                pairs.append((i, j))
    out = np.empty((len(pairs), 2), np.int64)
    for k in range(len(pairs)):
        out[k, 0], out[k, 1] = pairs[k]
    return out


@jit
def bar_each_other(pairs: IntArray, elements: Elements, meetings: Meetings, needle: Needle) -> bool:
    """Whether the needle enters one or the other of some pair of elements in either order."""
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        if entry_mm(i, j, elements, meetings, needle) > CERTAIN_MM and (
            entry_mm(j, i, elements, meetings, needle) > CERTAIN_MM
        ):
            return True
    return False
