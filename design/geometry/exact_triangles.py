"""Decide by exact integer arithmetic if two triangles intersect.

For the few pairs that `crossings` can't decide in floating point. Doubles are whole multiples of
a power of two, so that determinants of their differences are exact in Python's integers.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import frexp

Point = Sequence[int]
Triangle = Sequence[Point]

_DIGITS = 53
"""Of a double's fraction."""


def triangles_meet(
    one: Sequence[Sequence[float]],
    two: Sequence[Sequence[float]],
    corners: Sequence[int],
    others: Sequence[int],
) -> bool:
    """Whether two triangles meet in more than the corners and edges that they share.

    Parameters
    ----------
    one, two : (3, 3)
        Places of the corners.
    corners, others : (3,)
        Their numbers; the same number is the same place. A triangle without area meets any other.
    """
    points = _whole([*one, *two])
    first, second = points[:3], points[3:]
    axes = _axes(first)
    if axes is None or _axes(second) is None:
        return True
    shared = [corner for corner in corners if corner in others]
    if len(shared) == 3:
        return True
    if len(shared) == 2:
        return _folded(first, second, corners, others, axes)
    pairs = [(0, 1), (1, 2), (2, 0)]
    return any(
        _edge_meets(tri[i], tri[j], other)
        for tri, other, names in ((first, second, corners), (second, first, others))
        for i, j in pairs
        if names[i] not in shared and names[j] not in shared
    )


def _whole(points: Sequence[Sequence[float]]) -> list[tuple[int, ...]]:
    """Coordinates as multiples of one power of two."""
    parts = [[frexp(float(value)) for value in point] for point in points]
    low = min((power for point in parts for share, power in point if share), default=0)
    return [
        tuple(int(share * 2**_DIGITS) << (power - low) if share else 0 for share, power in point)
        for point in parts
    ]


def _side(a: Point, b: Point, c: Point, d: Point) -> int:
    """Sign of the volume of abcd."""
    p, q, r = ([x - y for x, y in zip(v, a, strict=True)] for v in (b, c, d))
    volume = (
        p[0] * (q[1] * r[2] - q[2] * r[1])
        + p[1] * (q[2] * r[0] - q[0] * r[2])
        + p[2] * (q[0] * r[1] - q[1] * r[0])
    )
    return (volume > 0) - (volume < 0)


def _exact_turn(a: Point, b: Point, c: Point, axes: tuple[int, int]) -> int:
    """Sign of the area of abc, seen along the third axis."""
    x, y = axes
    area = (b[x] - a[x]) * (c[y] - a[y]) - (b[y] - a[y]) * (c[x] - a[x])
    return (area > 0) - (area < 0)


def _axes(tri: Triangle) -> tuple[int, int] | None:
    """Axes along which a triangle has an area; None where it has none."""
    for axes in ((0, 1), (1, 2), (2, 0)):
        if _exact_turn(tri[0], tri[1], tri[2], axes):
            return axes
    return None


def _folded(
    one: Triangle,
    two: Triangle,
    corners: Sequence[int],
    others: Sequence[int],
    axes: tuple[int, int],
) -> bool:
    """Whether neighbours over an edge lie in one plane, on the same side of it."""
    own = next(k for k in range(3) if corners[k] not in others)
    its = next(k for k in range(3) if others[k] not in corners)
    if _side(one[0], one[1], one[2], two[its]):
        return False
    begin, end = one[(own + 1) % 3], one[(own + 2) % 3]
    return _exact_turn(begin, end, one[own], axes) == _exact_turn(begin, end, two[its], axes)


def _edge_meets(p: Point, q: Point, tri: Triangle) -> bool:
    """Whether the closed segment pq and the closed triangle have a point in common."""
    over, under = (_side(tri[0], tri[1], tri[2], end) for end in (p, q))
    if over * under > 0:
        return False
    if over == 0 and under == 0:
        return _meets_in_plane(p, q, tri)
    signs = {_side(p, q, tri[k], tri[(k + 1) % 3]) for k in range(3)}
    return not {1, -1} <= signs


def _meets_in_plane(p: Point, q: Point, tri: Triangle) -> bool:
    axes = _axes(tri)
    if axes is None:
        return True
    if any(_inside(end, tri, axes) for end in (p, q)):
        return True
    # An edge in one line with pq and inside of it: the other two edges' ends are on pq.
    return any(_cross(p, q, tri[k], tri[(k + 1) % 3], axes) for k in range(3))


def _inside(point: Point, tri: Triangle, axes: tuple[int, int]) -> bool:
    signs = {_exact_turn(tri[k], tri[(k + 1) % 3], point, axes) for k in range(3)}
    return not {1, -1} <= signs


def _cross(a: Point, b: Point, c: Point, d: Point, axes: tuple[int, int]) -> bool:
    """Whether segments cross, or an end of one is inside the other; not if all are in one line."""
    one = _exact_turn(a, b, c, axes) * _exact_turn(a, b, d, axes)
    two = _exact_turn(c, d, a, axes) * _exact_turn(c, d, b, axes)
    return one <= 0 and two <= 0 and one + two < 0
