"""Check that a branch fits at its new parent, and that the vessels left behind still fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.vasculature.growth.clearances import Clearances, TrialBifurcation, neighbours_of
from design.vasculature.growth.fit import seven_integers
from design.vasculature.growth.index import CellIndex
from design.vasculature.growth.joint_limits import end_fits, losing_fits, start_fits
from design.vasculature.growth.joints import joint_fits
from design.vasculature.options import Law
from design.vasculature.polish.fit import (
    capsule_fits,
    far_end,
    near_end,
    slack_above,
    slack_below,
    stretch,
)
from design.vasculature.polish.relax import root_radius
from kernels import jit


@jit
def fork_fits(
    index: CellIndex, segments: Any, room: Clearances, fork: TrialBifurcation, c: Any, gone: Any
) -> bool:
    """Whether branch ``c`` fits on the fork's segment; ``gone`` is no obstacle any more."""
    i = int(fork.segment)
    b, t = (fork.bx, fork.by, fork.bz), (fork.tx, fork.ty, fork.tz)
    s, branch = segments[i], segments[c]
    p, d = near_end(s), far_end(s)
    if not joint_fits(segments, room, fork):
        return False
    if (
        slack_above(segments, room, i, b, fork.up) < 0.0
        or slack_below(segments, room, i, b, fork.low) < 0.0
        or slack_below(segments, room, c, b, fork.new) < 0.0
    ):
        return False
    if room.limits.on and not end_fits(segments, room.limits, c, b):
        return False
    parent, sibling, left, right = neighbours_of(segments, i)
    skip = seven_integers(i, c, gone, branch.left, branch.right, -1, -1)
    if not capsule_fits(index, segments, room, b, t, fork.new, skip):
        return False
    skip = seven_integers(i, c, gone, parent, sibling, -1, -1)
    if not capsule_fits(index, segments, room, p, b, fork.up, skip):
        return False
    skip = seven_integers(i, c, gone, left, right, -1, -1)
    return bool(capsule_fits(index, segments, room, b, d, fork.low, skip))


@jit
def straight_fits(
    index: CellIndex, segments: Any, room: Clearances, p: Any, c: Any, gone: Any, radius: float
) -> bool:
    """Whether the straight left by `cut` fits."""
    s = segments[p]
    a, b = near_end(s), far_end(s)
    if stretch(room, s.length, radius) < 0.0:
        return False
    if (
        slack_above(segments, room, p, b, radius) < 0.0
        or slack_below(segments, room, p, a, radius) < 0.0
    ):
        return False
    limits = room.limits
    if limits.on and not (
        start_fits(segments, limits, p, b)
        and end_fits(segments, limits, p, a)
        and losing_fits(segments, limits, p)
    ):
        return False
    parent, sibling, left, right = neighbours_of(segments, p)
    skip = seven_integers(p, c, gone, parent, sibling, left, right)
    return bool(capsule_fits(index, segments, room, a, b, radius, skip))


@jit
def way_fits(segments: Any, i: Any, flow_over_drop: float, law: Law) -> bool:
    """Whether all from segment ``i`` to the root may be as wide as they are now.

    Judged by what each was allowed at the last audit.
    """
    here = i
    share = 1.0
    while segments[here].parent >= 0:
        share *= _share(segments, here, law)
        here = segments[here].parent
    root = root_radius(segments, flow_over_drop)
    # The parted segment itself has been tried where it is now.
    here = i
    while segments[here].parent > 0:
        share /= _share(segments, here, law)
        here = segments[here].parent
        radius = root * np.sqrt(np.sqrt(share))
        if radius > segments[here].allowed and radius > segments[here].radius:
            return False
    return bool(root <= segments[0].allowed or root <= segments[0].radius)


@jit
def _share(segments: Any, i: Any, law: Law) -> float:
    """Load over the joint load at a segment's near end: the fourth power of its ratio."""
    up = segments[segments[i].parent]
    m = up.load - up.flow * up.thick * law.k * up.length
    return segments[i].load / m


@jit
def branch_fits(segments: Any, c: Any, factor: float) -> bool:
    """Whether all of branch ``c`` below its first segment may be ``factor`` times as wide."""
    if factor <= 1.0 or segments[c].left < 0:
        return True
    stack = np.empty(segments[c].terminals + 1, np.int32)
    stack[0], stack[1] = segments[c].left, segments[c].right
    top = 2
    while top > 0:
        top -= 1
        s = segments[stack[top]]
        if s.radius * factor > s.allowed:
            return False
        if s.left >= 0:
            stack[top] = s.left
            stack[top + 1] = s.right
            top += 2
    return True
