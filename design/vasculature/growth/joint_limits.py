"""Check bifurcations against limits on branching angles and flow split."""

from __future__ import annotations

from math import sqrt
from typing import Any

from design.vasculature.growth.clearances import neighbours_of
from design.vasculature.limits import Limits
from kernels import jit, scalar_jit

_ROUNDING = 1e-12


@jit
def _cosine(at: Any, a: Any, b: Any) -> float:
    """Cosine of the angle at one point between the ways to two others; 1 where there is none."""
    ux, uy, uz = a[0] - at[0], a[1] - at[1], a[2] - at[2]
    vx, vy, vz = b[0] - at[0], b[1] - at[1], b[2] - at[2]
    size = sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz))
    if not size > 0.0:
        return 1.0
    return (ux * vx + uy * vy + uz * vz) / size


@jit
def angles_fit(limits: Limits, begin: Any, at: Any, one: Any, two: Any) -> bool:
    """Whether a joint at ``at`` keeps the limits on angles.

    Parameters
    ----------
    begin : (float, float, float), mm
        Where the parent comes from.
    one, two : (float, float, float), mm
        Ends of the children.
    """
    c = _cosine(at, one, two)
    if c > limits.narrow + _ROUNDING or c < limits.wide - _ROUNDING:
        return False
    for end in (one, two):
        c = -_cosine(at, begin, end)
        if c > limits.slight + _ROUNDING or c < limits.sharp - _ROUNDING:
            return False
    return True


@jit
def shares_fit(limits: Limits, one: float, two: float) -> bool:
    """Whether two children's flows are near enough to each other."""
    return bool(min(one, two) >= (limits.share - _ROUNDING) * max(one, two))


@scalar_jit
def flows_fit(segments: Any, limits: Limits, i: Any, flow: float) -> bool:
    """Whether a fork on segment ``i`` for a branch of ``flow`` parts the flow as it must.

    On the way to the root no joint may be pushed out of the limits, or further out.
    """
    if limits.share <= 0.0:
        return True
    if not shares_fit(limits, segments[i].flow, flow):
        return False
    here = i
    while segments[here].parent >= 0:
        _, sibling, _, _ = neighbours_of(segments, here)
        if sibling >= 0:
            mine, other = segments[here].flow + flow, segments[sibling].flow
            fixed = segments[here].given != 0 and segments[sibling].given != 0
            if not fixed and mine > other and not shares_fit(limits, mine, other):
                return False
        here = segments[here].parent
    return True


@scalar_jit
def fork_within_limits(segments: Any, limits: Limits, fork: Any) -> bool:
    """Whether a fork's joint, and those at either end of the parted segment, keep the limits."""
    i = int(fork.segment)
    s = segments[i]
    p, d = (s.px, s.py, s.pz), (s.dx, s.dy, s.dz)
    b, t = (fork.bx, fork.by, fork.bz), (fork.tx, fork.ty, fork.tz)
    if not angles_fit(limits, p, b, d, t):
        return False
    # The parts of a trunk's segment go on as it did.
    if s.given == 0 and not (
        start_fits(segments, limits, i, b) and end_fits(segments, limits, i, b)
    ):
        return False
    return flows_fit(segments, limits, i, fork.flow)


@scalar_jit
def start_fits(segments: Any, limits: Limits, i: Any, end: Any) -> bool:
    """Whether the joint at the near end of segment ``i`` keeps the limits if it ends at ``end``."""
    parent, sibling, _, _ = neighbours_of(segments, i)
    if parent < 0 or sibling < 0:
        return True
    up, s, o = segments[parent], segments[i], segments[sibling]
    return angles_fit(limits, (up.px, up.py, up.pz), (s.px, s.py, s.pz), end, (o.dx, o.dy, o.dz))


@scalar_jit
def end_fits(segments: Any, limits: Limits, i: Any, begin: Any) -> bool:
    """Whether the joint at its far end keeps the limits if segment ``i`` begins at ``begin``."""
    s = segments[i]
    if s.left < 0 or s.right < 0:
        return True
    a, b = segments[s.left], segments[s.right]
    return angles_fit(limits, begin, (s.dx, s.dy, s.dz), (a.dx, a.dy, a.dz), (b.dx, b.dy, b.dz))


@scalar_jit
def joint_within_limits(segments: Any, limits: Limits, i: Any) -> bool:
    """Whether the joint at the far end of segment ``i`` keeps all limits."""
    s = segments[i]
    if s.left < 0 or s.right < 0:
        return True
    if not end_fits(segments, limits, i, (s.px, s.py, s.pz)):
        return False
    return shares_fit(limits, segments[s.left].flow, segments[s.right].flow)
