"""Elementary edits of a tree: cut a branch off, attach it to another segment, undo either."""

from __future__ import annotations

from typing import Any

from design.vasculature.growth.clearances import TrialBifurcation, neighbours_of
from design.vasculature.growth.state import place, refresh, refresh_upwards
from design.vasculature.options import Law
from design.vasculature.polish.fit import far_end, near_end
from kernels import jit


@jit
def is_below(segments: Any, i: Any, top: Any) -> bool:
    """Whether segment ``i`` is ``top`` or downstream of it."""
    while i >= 0:
        if i == top:
            return True
        i = segments[i].parent
    return False


@jit
def cut_branch(segments: Any, c: Any, saved: Any, law: Law) -> int:
    """Take branch ``c`` off; its parent and sibling become one straight, the parent's record.

    ``saved`` (3,) receives parent, sibling and branch as they were. Returns the sibling, whose
    record is free now.
    """
    parent, sibling, _, _ = neighbours_of(segments, c)
    p, a = int(parent), int(sibling)
    saved[0], saved[1], saved[2] = segments[p], segments[a], segments[c]
    up, low = segments[p], segments[a]
    place(segments, p, near_end(up), far_end(low))
    up.left, up.right, up.flow = low.left, low.right, low.flow
    if up.left >= 0:
        segments[up.left].parent, segments[up.right].parent = p, p
    refresh_upwards(segments, p, law)
    return a


@jit
def undo_cut(segments: Any, p: Any, a: Any, c: Any, saved: Any, law: Law) -> None:
    """Undo `cut_branch`."""
    segments[p], segments[a], segments[c] = saved[0], saved[1], saved[2]
    if segments[a].left >= 0:
        segments[segments[a].left].parent, segments[segments[a].right].parent = a, a
    refresh_upwards(segments, p, law)


@jit
def attach(segments: Any, fork: TrialBifurcation, c: Any, free: Any, law: Law) -> None:
    """Part the fork's segment at its place and hang branch ``c`` there; ``free`` is used."""
    i = int(fork.segment)
    s = segments[i]
    b = (fork.bx, fork.by, fork.bz)
    segments[free] = s
    low, branch = segments[free], segments[c]
    place(segments, free, b, far_end(low))
    place(segments, c, b, far_end(branch))
    place(segments, i, near_end(s), b)
    if low.left >= 0:
        segments[low.left].parent, segments[low.right].parent = free, free
    low.parent, branch.parent = i, i
    s.left, s.right = free, c
    s.radius, low.radius, branch.radius = fork.up, fork.low, fork.new
    refresh(segments, free, law)
    refresh(segments, c, law)
    refresh_upwards(segments, i, law)


@jit
def detach(segments: Any, i: Any, free: Any, was: Any, law: Law) -> None:
    """Undo `attach`; ``was`` is the parted segment's record before."""
    low = segments[free]
    if low.left >= 0:
        segments[low.left].parent, segments[low.right].parent = i, i
    segments[i] = was
    refresh_upwards(segments, i, law)
