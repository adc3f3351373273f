"""Traverse a triangle bounding-volume tree for the leaves that overlap a box."""

from __future__ import annotations

from typing import Any

from kernels import jit


@jit
def corners_box(corners: Any, low: Any, high: Any) -> None:
    """Write the box of a triangle's corners (3, 3) into ``low`` and ``high`` (3,)."""
    for axis in range(3):
        low[axis] = min(corners[0, axis], min(corners[1, axis], corners[2, axis]))
        high[axis] = max(corners[0, axis], max(corners[1, axis], corners[2, axis]))


@jit
def boxes_apart(corners: Any, low: Any, high: Any) -> bool:
    """Whether a triangle's own box (of corners (3, 3)) and the box low to high don't meet."""
    for axis in range(3):
        if max(corners[0, axis], max(corners[1, axis], corners[2, axis])) < low[axis]:
            return True
        if min(corners[0, axis], min(corners[1, axis], corners[2, axis])) > high[axis]:
            return True
    return False


@jit
def next_leaf(tree: Any, low: Any, high: Any, stack: Any, top: int) -> tuple[int, int]:
    """Return the next leaf whose box meets low to high, and how many nodes wait on the stack.

    Begin with ``stack[0] = 0`` (DEPTH int32) and ``top = 1``; after the last leaf it is -1.
    """
    while top > 0:
        top -= 1
        node = stack[top]
        met = True
        for axis in range(3):
            if low[axis] > tree.high[node, axis] or high[axis] < tree.low[node, axis]:
                met = False
        if not met:
            continue
        if tree.right[node] < 0:
            return node, top
        stack[top] = tree.right[node]
        stack[top + 1] = node + 1
        top += 2
    return -1, 0
