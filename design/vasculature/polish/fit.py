"""Check that a moved branch point fits (tissue, vessels, joints); measure the room at joints."""

from __future__ import annotations

from typing import Any

from design.geometry import point_segment
from design.vasculature.growth.bifurcation import distance
from design.vasculature.growth.clearances import Clearances, kept_apart, neighbours_of
from design.vasculature.growth.fit import growth_factor, in_tissue, seven_integers
from design.vasculature.growth.index import CellIndex
from design.vasculature.growth.joint_limits import node_within_limits
from kernels import jit

JOINT = 1.01
"""Joints are judged with radii so much larger than they are: later moves change them a little."""


@jit
def near_end(s: Any) -> tuple[float, float, float]:
    """Proximal end of a segment."""
    return (s.px, s.py, s.pz)


@jit
def far_end(s: Any) -> tuple[float, float, float]:
    """Distal end of a segment."""
    return (s.dx, s.dy, s.dz)


@jit
def length_of(a: Any, b: Any) -> float:
    """Distance of two points."""
    return distance(a[0], a[1], a[2], b[0], b[1], b[2])


@jit
def elbow(room: Clearances, at: Any, a: Any, ra: float, b: Any, rb: float) -> float:
    """Room between two segments from one node to ``a`` and ``b``, over their radii.

    The far end of each must clear the other; negative where one doesn't.
    """
    one, _ = point_segment(a[0], a[1], a[2], at[0], at[1], at[2], b[0], b[1], b[2])
    two, _ = point_segment(b[0], b[1], b[2], at[0], at[1], at[2], a[0], a[1], a[2])
    both = JOINT * (ra + rb)
    return (min(one, two) - both - kept_apart(room, ra, rb)) / both


@jit
def stretch(room: Clearances, length: float, radius: float) -> float:
    """Room between a length and the shortest allowed, over the radius."""
    return length / (JOINT * radius) - room.length_to_radius


@jit
def slack_above(segments: Any, room: Clearances, i: int, end: Any, radius: float) -> float:
    """Least room at the near end of segment ``i`` if it ended at ``end``."""
    parent, sibling, _, _ = neighbours_of(segments, i)
    if parent < 0:
        return 1.0
    at = near_end(segments[i])
    up, other = segments[parent], segments[sibling]
    return min(
        elbow(room, at, end, radius, near_end(up), up.radius),
        elbow(room, at, end, radius, far_end(other), other.radius),
    )


@jit
def slack_below(segments: Any, room: Clearances, i: int, begin: Any, radius: float) -> float:
    """Least room at the far end of segment ``i`` if it began at ``begin``."""
    s = segments[i]
    if s.left < 0:
        return 1.0
    at = far_end(s)
    a, b = segments[s.left], segments[s.right]
    return min(
        elbow(room, at, begin, radius, far_end(a), a.radius),
        elbow(room, at, begin, radius, far_end(b), b.radius),
    )


@jit
def node_slack(segments: Any, room: Clearances, i: int, b: Any, radii: Any) -> float:
    """Least room in the joints that move with the far end of segment ``i`` to ``b``.

    ``radii`` are those of the segment, its left and its right child.
    """
    s = segments[i]
    p, a, c = near_end(s), far_end(segments[s.left]), far_end(segments[s.right])
    least = min(
        stretch(room, length_of(p, b), radii[0]),
        stretch(room, length_of(b, a), radii[1]),
        stretch(room, length_of(b, c), radii[2]),
    )
    least = min(least, elbow(room, b, p, radii[0], a, radii[1]))
    least = min(least, elbow(room, b, p, radii[0], c, radii[2]))
    least = min(least, elbow(room, b, a, radii[1], c, radii[2]))
    least = min(least, slack_above(segments, room, i, b, radii[0]))
    least = min(least, slack_below(segments, room, s.left, b, radii[1]))
    return min(least, slack_below(segments, room, s.right, b, radii[2]))


@jit
def node_fits(
    index: CellIndex, segments: Any, room: Clearances, i: int, b: Any, radii: Any, joint: float
) -> bool:
    """Whether the far end of segment ``i`` may move to ``b``; the cheap tests first.

    ``joint`` is the room that the joints must leave at least, 0 or what there is now.
    """
    if node_slack(segments, room, i, b, radii) < joint:
        return False
    if room.limits.on and not node_within_limits(segments, room.limits, i, b):
        return False
    s = segments[i]
    left, right = s.left, s.right
    p, a, c = near_end(s), far_end(segments[left]), far_end(segments[right])
    if not in_tissue(room, p[0], p[1], p[2], b[0], b[1], b[2], radii[0]):
        return False
    if not in_tissue(room, b[0], b[1], b[2], a[0], a[1], a[2], radii[1]):
        return False
    if not in_tissue(room, b[0], b[1], b[2], c[0], c[1], c[2], radii[2]):
        return False
    parent, sibling, _, _ = neighbours_of(segments, i)
    skip = seven_integers(i, parent, sibling, left, right, -1, -1)
    if not _clear(index, segments, room, p, b, radii[0], skip):
        return False
    skip = seven_integers(i, left, right, segments[left].left, segments[left].right, -1, -1)
    if not _clear(index, segments, room, b, a, radii[1], skip):
        return False
    skip = seven_integers(i, left, right, segments[right].left, segments[right].right, -1, -1)
    return _clear(index, segments, room, b, c, radii[2], skip)


@jit
def _clear(
    index: CellIndex, segments: Any, room: Clearances, a: Any, b: Any, radius: float, skip: Any
) -> bool:
    free = growth_factor(
        index, segments, room, a[0], a[1], a[2], b[0], b[1], b[2], radius, skip, False
    )
    return bool(free >= room.reserve)


@jit
def capsule_fits(
    index: CellIndex, segments: Any, room: Clearances, a: Any, b: Any, radius: float, skip: Any
) -> bool:
    """Whether a capsule from ``a`` to ``b`` is in the tissue and clear of all but ``skip``."""
    if not in_tissue(room, a[0], a[1], a[2], b[0], b[1], b[2], radius):
        return False
    return _clear(index, segments, room, a, b, radius, skip)
