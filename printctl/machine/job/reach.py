"""Data class of a job's extent: xy hulls, lowest and highest tip, fastest plunger push."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from printctl.machine.job.modal import declared_axes
from sim.gcode.reading import is_motion

Point = tuple[float, float]
Place = tuple[float, float, float]
ASIDE_MM: Final = 1.0
"""So far beside the hull of the job's moves a needle may still go below the job's top."""
_HEIGHTS_MM: Final = 1e-6


@dataclass(frozen=True)
class JobReach:
    """What a job's moves keep to, counted from where the tip was touched off.

    Attributes
    ----------
    low_mm, top_mm : float, mm
        Least and greatest height; infinite the other way round where no move names any.
    hull_mm : tuple of (x, y), mm
        Corners, against the clock, of what its moves below ``top_mm`` stand on; of all its moves
        where every one is as high.
    push_mm_s : float, mm/s
        Fastest that its moves push the plunger.
    high_hull_mm : tuple of (x, y), mm
        Corners of what all its moves stand on; empty where that is ``hull_mm``.
    """

    low_mm: float
    top_mm: float
    hull_mm: tuple[Point, ...]
    push_mm_s: float = 0.0
    high_hull_mm: tuple[Point, ...] = ()

    @staticmethod
    def of(
        lines: Sequence[bytes],
        start_mm: Place | None = None,
        shift_at: Callable[[int], Place] = lambda index: (0.0, 0.0, 0.0),
    ) -> JobReach:
        """Read it from a job's lines.

        Parameters
        ----------
        lines : sequence of bytes
        start_mm : (x, y, z), mm, optional
            Where the tip stands before the first.
        shift_at : callable
            What places are called at a line beyond the count from the touch-off
            (`JobFrame.shift_at`), mm.
        """
        x, y, z = start_mm or (math.nan,) * 3
        e = feed = math.nan
        places, fastest = set[Place](), 0.0
        for index, line in enumerate(lines):
            if not is_motion(line):
                told = declared_axes(line) if line[:1] != b"M" else {}
                x, y, z = told.get("X", x), told.get("Y", y), told.get("Z", z)
                e = math.nan if line.startswith(b"G92") else e
                continue
            words = _words(line)
            to = words.get(b"X", x), words.get(b"Y", y), words.get(b"Z", z)
            pushed, feed = words.get(b"E", e), words.get(b"F", feed)
            if pushed > e and feed > 0:
                way = math.dist((x, y, z), to)
                fastest = max(fastest, feed / 60 * ((pushed - e) / way if way > 0 else 1.0))
            dx, dy, dz = shift_at(index)
            if pushed > e and not places:  # the first line is written from where it was touched off
                places.add((x - dx, y - dy, z - dz))
            (x, y, z), e = to, pushed
            places.add((x - dx, y - dy, z - dz))
        heights = [z for _, _, z in places if z == z]
        low, top = min(heights, default=math.inf), max(heights, default=-math.inf)
        known = [place for place in places if place[0] == place[0] and place[1] == place[1]]
        below = _hull({(x, y) for x, y, z in known if z < top - _HEIGHTS_MM})
        high = _hull({*below, *((x, y) for x, y, z in known if not z < top - _HEIGHTS_MM)})
        return JobReach(low, top, below or high, fastest, high)

    def is_inside(self, x: float, y: float, z: float) -> bool:
        """Whether a place is within the hull of its height, or at most `ASIDE_MM` beside it."""
        high = z >= self.top_mm - _HEIGHTS_MM and self.high_hull_mm
        corners = high or self.hull_mm
        if len(corners) < 3:
            pairs = list(zip(corners, corners[1:] or corners, strict=False))
            return any(_apart_mm(one, other, (x, y)) <= ASIDE_MM for one, other in pairs)
        edges = list(zip(corners, (*corners[1:], corners[0]), strict=True))
        if all(_turn(one, other, (x, y)) >= 0 for one, other in edges):
            return True
        return any(_apart_mm(one, other, (x, y)) <= ASIDE_MM for one, other in edges)


def _words(line: bytes) -> dict[bytes, float]:
    return {word[:1]: float(word[1:]) for word in line.split(b" ")[1:] if len(word) > 1}


def _hull(points: set[Point]) -> tuple[Point, ...]:
    """Convex hull, against the clock (A. M. Andrew, Inf. Process. Lett. 9, 216, 1979)."""
    order = sorted(points)
    if len(order) < 3:
        return tuple(order)
    return (*_half(order), *_half(order[::-1]))


def _half(order: Sequence[Point]) -> list[Point]:
    points: list[Point] = []
    for point in order:
        while len(points) > 1 and _turn(points[-2], points[-1], point) <= 0:
            points.pop()
        points.append(point)
    return points[:-1]


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _apart_mm(a: Point, b: Point, c: Point) -> float:
    """Distance of ``c`` from the way between ``a`` and ``b``, mm."""
    length = math.dist(a, b)
    along = (b[0] - a[0]) * (c[0] - a[0]) + (b[1] - a[1]) * (c[1] - a[1])
    share = min(max(along / length**2, 0.0), 1.0) if length else 0.0
    return math.dist((a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])), c)
