"""Find pairs of capsules without a common node closer than a clearance, by a tree of boxes."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry.bvh import DEPTH, build_hierarchy
from design.geometry.segments import segment_segment
from kernels import jit
from kernels.arrays import FloatArray, IntArray


def close_pairs(
    start: FloatArray,
    end: FloatArray,
    radius: FloatArray,
    nodes: IntArray,
    clearance_mm: float,
    clearance_ratio: float,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Pairs of pieces without a common node and with a gap below the clearance.

    Parameters
    ----------
    start, end : (n, 3) float64, mm
    radius : (n,) float64, mm
    nodes : (n, 2) int64
        At the two ends of each piece.
    clearance_mm, clearance_ratio : float
        See `design.vasculature.collide.collisions`.

    Returns
    -------
    pairs : (k, 2) int64
        Sorted.
    gap : (k,) float64, mm
    place : (k, 3) float64, mm
        Midway between the axes where these are nearest.
    """
    # Boxes of two pieces that are too near meet.
    reach = (radius + 0.5 * np.maximum(clearance_mm, clearance_ratio * radius))[:, None]
    own = np.concatenate([np.minimum(start, end) - reach, np.maximum(start, end) + reach], axis=1)
    boxes, tree, order = build_hierarchy(own)
    size, count = 0, 1024
    while count > size:
        size = count
        pairs, values = np.empty((size, 2), np.int64), np.empty((size, 4))
        count = _close_pairs(
            own,
            boxes,
            tree,
            order,
            start,
            end,
            radius,
            nodes,
            clearance_mm,
            clearance_ratio,
            pairs,
            values,
        )
    first = np.lexsort((pairs[:count, 1], pairs[:count, 0]))
    return pairs[first], values[first, 0], values[first, 1:]


@jit
def _are_apart(one: Any, two: Any) -> bool:
    """Whether two boxes (6,) don't meet."""
    apart = False
    for axis in range(3):
        apart |= one[axis] > two[3 + axis] or two[axis] > one[3 + axis]
    return apart


@jit
def _close_pairs(
    own: Any,
    boxes: Any,
    tree: Any,
    order: Any,
    start: Any,
    end: Any,
    radius: Any,
    nodes: Any,
    clearance: float,
    ratio: float,
    pairs: Any,
    values: Any,
) -> int:
    """Write close pairs; return how many there are, written or not."""
    count = 0
    stack = np.empty(DEPTH, np.int64)
    for leaf in range(len(tree)):
        if tree[leaf, 0] >= 0:
            continue
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if _are_apart(boxes[leaf], boxes[node]):
                continue
            left, right = tree[node]
            if left >= 0:
                stack[top] = right
                top += 1
                # Left of a node that isn't after the leaf's lie only pieces before its own.
                if right > leaf:
                    stack[top] = left
                    top += 1
                continue
            if node < leaf:
                continue
            for m in range(-1 - tree[leaf, 0], tree[leaf, 1]):
                for n in range(m + 1 if node == leaf else -1 - left, right):
                    i, j = min(order[m], order[n]), max(order[m], order[n])
                    if _are_apart(own[i], own[j]) or _share_node(nodes[i], nodes[j]):
                        continue
                    a, b, p, q = start[i], end[i], start[j], end[j]
                    d, s, t = segment_segment(
                        a[0], a[1], a[2], b[0], b[1], b[2], p[0], p[1], p[2], q[0], q[1], q[2]
                    )
                    gap = d - radius[i] - radius[j]
                    if gap >= max(clearance, ratio * min(radius[i], radius[j])):
                        continue
                    if count < len(pairs):
                        pairs[count, 0], pairs[count, 1] = i, j
                        values[count, 0] = gap
                        for k in range(3):
                            one = a[k] + s * (b[k] - a[k])
                            two = p[k] + t * (q[k] - p[k])
                            values[count, k + 1] = 0.5 * (one + two)
                    count += 1
    return count


@jit
def _share_node(one: Any, two: Any) -> bool:
    """Whether two pieces have an end (2,) in common."""
    return one[0] == two[0] or one[0] == two[1] or one[1] == two[0] or one[1] == two[1]
