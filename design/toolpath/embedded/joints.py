"""Where passes meet: each end that comes to ink is carried on into it, so that the two hold.

A pass that begins or ends where ink lies goes on straight by the overlap. Where the shaft would
pass through other ink there, the earlier of the two goes on instead, when less lay about. What
can be closed from neither side stays open, and is named.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.meetings import Meetings
from design.toolpath.embedded.needle import Needle
from design.toolpath.embedded.rules import depth_at
from design.toolpath.embedded.schedule import Pass
from design.toolpath.embedded.squares import Squares
from design.toolpath.toolpath import FloatArray, IntArray
from kernels import jit


@dataclass(frozen=True)
class OpenJoint:
    """Two stretches that meet and can't be made to overlap.

    Attributes
    ----------
    vessel, other : int
        The later and the earlier one.
    place_mm : (3,) float64, mm
    element : int
        The later stretch's, at the joint.
    barred_by : (k,) int64
        Elements of other ink in the way of its overlap.
    """

    vessel: int
    other: int
    place_mm: FloatArray
    element: int
    barred_by: IntArray


@dataclass
class Joined:
    """Passes with their overlaps.

    Attributes
    ----------
    before, beyond : (p,) float64, mm
        How far each pass begins before its first point, and goes on beyond its last.
    joints, overlapped : int
        Ends that come to ink; of these, those closed by an overlap.
    through : int
        Stretches that go on from the last one through a node without a stop.
    open : list of OpenJoint
    """

    before: FloatArray
    beyond: FloatArray
    joints: int
    overlapped: int
    through: int
    open: list[OpenJoint]


@dataclass(frozen=True)
class _End:
    """One end of a pass: the pass, whether its last point, and the element there."""

    number: int
    last: bool
    element: int


_Ends = dict[int, list[_End]]
"""Passes that end at each point."""
_Inked = dict[int, int]
"""The element last written at each point."""


class Joiner:
    """Closes the joints of ordered passes."""

    def __init__(
        self, elements: Elements, squares: Squares, meetings: Meetings, needle: Needle
    ) -> None:
        self._elements, self._squares = elements, squares
        self._meetings, self._needle = meetings, needle

    def join(self, passes: list[Pass]) -> Joined:
        """Close what can be closed."""
        out = Joined(np.zeros(len(passes)), np.zeros(len(passes)), 0, 0, 0, [])
        when = self._when(passes)
        ends: _Ends = {}
        inked: _Inked = {}
        for number, one in enumerate(passes):
            order, points = one.elements().tolist(), self._points(one)
            out.through += len(one.legs) - 1
            out.joints += len(one.legs) - 1
            begin, end = _End(number, False, order[0]), _End(number, True, order[-1])
            self._meet(out, when, begin, points[0], ends, inked)
            ends.setdefault(points[0], []).append(begin)
            inked[points[0]] = order[0]
            for point, element in zip(points[1:-1], order[1:], strict=True):
                if point in inked:
                    self._go_through(out, when, element, point, ends, inked)
                inked[point] = element
            self._meet(out, when, end, points[-1], ends, inked)
            ends.setdefault(points[-1], []).append(end)
            inked[points[-1]] = order[-1]
        return out

    def _when(self, passes: list[Pass]) -> IntArray:
        """Number of the pass that writes each element."""
        when = np.empty(len(self._elements.end), dtype=np.int64)
        for number, one in enumerate(passes):
            when[one.elements()] = number
        return when

    def _points(self, one: Pass) -> list[int]:
        """Points that a pass goes through, one more than its elements."""
        found: list[int] = []
        for leg in one.legs:
            side = (0, 1) if leg.step > 0 else (1, 0)
            ends = self._elements.end[leg.elements()]
            found += ends[:, side[0]].tolist()
        return [*found, int(ends[-1, side[1]])]

    def _meet(
        self, out: Joined, when: IntArray, end: _End, point: int, ends: _Ends, inked: _Inked
    ) -> None:
        """A pass begins or ends at a point; where ink lies, it or an earlier one goes on."""
        if point in inked:
            sides = [end, *reversed(ends.get(point, []))]
            self._close(out, when, sides, point, (end.element, inked[point]))

    def _go_through(
        self, out: Joined, when: IntArray, element: int, point: int, ends: _Ends, inked: _Inked
    ) -> None:
        """A pass goes through a point where ink lies: what ended there must reach beyond it."""
        earlier = ends.get(point, [])
        reached = any((out.beyond if e.last else out.before)[e.number] > 0.0 for e in earlier)
        if reached or not earlier:
            out.joints += 1
            out.overlapped += 1
        else:
            self._close(out, when, earlier[::-1], point, (element, inked[point]))

    def _close(
        self, out: Joined, when: IntArray, sides: list[_End], point: int, met: tuple[int, int]
    ) -> None:
        """Carry the first of `sides` that can be on beyond a point.

        ``met`` are the later element there and the earlier one.
        """
        out.joints += 1
        later, earlier = met
        reach = self._needle.overlap_radii * min(self._radius(later), self._radius(earlier))
        if reach == 0.0:
            return
        barred: list[IntArray] = []
        for side in sides:
            barred.append(self._barred(side, point, reach, when))
            if not len(barred[-1]):
                far = out.beyond if side.last else out.before
                far[side.number] = max(far[side.number], reach)
                out.overlapped += 1
                return
        vessel, place = self._elements.vessel, self._elements.point[point]
        out.open.append(
            OpenJoint(int(vessel[later]), int(vessel[earlier]), place, later, barred[0])
        )

    def _radius(self, element: int) -> float:
        return float(self._elements.radius[element].max())

    def _barred(self, end: _End, point: int, reach: float, when: IntArray) -> IntArray:
        """Elements written by then that the shaft would meet so far beyond an end."""
        elements, element = self._elements, end.element
        tail, head = elements.end[element]
        inner = int(tail) if int(head) == point else int(head)
        here = elements.point[point]
        way = here - elements.point[inner]
        tip = here + reach * way / np.linalg.norm(way)
        at = elements.arc[element] + (elements.length[element] if int(head) == point else 0.0)
        return _met(
            tip, self._radius(element), int(elements.vessel[element]), float(at),
            end.number + end.last, when, elements, self._squares, self._meetings, self._needle,
        )  # fmt: skip


@jit
def _met(
    tip: FloatArray,
    radius: float,
    vessel: int,
    at: float,
    now: int,
    when: IntArray,
    elements: Elements,
    squares: Squares,
    meetings: Meetings,
    needle: Needle,
) -> IntArray:
    """Elements of passes before the one numbered `now` that the shaft above a tip meets."""
    met = [0][:0]
    column = int((tip[0] - squares.origin[0]) / squares.pitch)
    row = int((tip[1] - squares.origin[1]) / squares.pitch)
    for x in range(max(0, column - 1), min(squares.shape[0], column + 2)):
        for y in range(max(0, row - 1), min(squares.shape[1], row + 2)):
            square = x * squares.shape[1] + y
            for m in range(squares.begin[square], squares.begin[square + 1]):
                j = squares.member[m]
                if when[j] < now and (
                    depth_at(tip, radius, vessel, at, j, elements, meetings, needle) > 0.0
                ):
                    met.append(j)
    return np.array(met, np.int64)
