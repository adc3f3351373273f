"""Close the joints of writing strokes: extend each stroke's ends into the ink they meet.

A pass that begins or ends where ink lies goes on straight by the overlap. Where the shaft would
pass through other ink there, or later ones through the overlap, the earlier of the two goes on
instead, when less lay about. Where no side has room, a part of the overlap does; what can be closed
from neither side stays open, and is named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from design.toolpath.embedded.elements import Elements, Squares, near
from design.toolpath.embedded.needle import Needle, joint_reach, off_shaft, radius_at
from design.toolpath.embedded.order.schedule import Pass
from design.toolpath.embedded.report import BrushedOverlap, JoinedPasses, WeakJoint
from design.toolpath.embedded.rules import (
    TIPS,
    Meetings,
    depth_at,
    flat_gap,
    of_one_joint,
    tip_along,
)
from kernels import jit
from kernels.arrays import FloatArray, IntArray

NEVER: Final = 1 << 40
"""When an element is written that isn't."""


class Extension(NamedTuple):
    """A short straight way beyond the end of a pass, as thick as the vessel there."""

    start: FloatArray  # (3,), mm
    tip: FloatArray  # (3,), mm
    radius: float  # mm
    vessel: int
    at: float  # way along the vessel to where it begins, mm
    step: int  # 1 where it leads on along the vessel's order, -1 where against it
    far: float  # way along the vessel to its other end where it leads past one, mm; else inf


@jit
def barring(
    extension: Extension,
    before: int,
    when: IntArray,
    elements: Elements,
    squares: Squares,
    meetings: Meetings,
    needle: Needle,
) -> IntArray:
    """Elements of passes before the one numbered `before` that its shaft meets; ``when`` (n,)."""
    met = [0][:0]
    places, ways = _places(extension, 0.5 * needle.tip_mm)
    for n in range(len(ways)):
        place = places[n]
        for k in range(3):
            low, high = near(squares, place, k)
            for m in range(low, high):
                x, y, top, reach = squares.around[m]
                far = (x - place[0]) ** 2 + (y - place[1]) ** 2 >= (needle.shaft_mm + reach) ** 2
                j = squares.member[m]
                if far or top <= place[2] or when[j] >= before:
                    continue
                depth = depth_at(
                    place, extension.radius, extension.vessel, ways[n], j, elements, meetings,
                    needle, extension.far,
                )[0]  # fmt: skip
                if depth > 0.0:
                    met.append(j)
    return np.unique(np.array(met, np.int64))


@jit
def barred(
    extension: Extension,
    since: int,
    when: IntArray,
    elements: Elements,
    squares: Squares,
    meetings: Meetings,
    needle: Needle,
) -> IntArray:
    """Elements of the pass numbered `since` and later, which take the shaft through its ink."""
    met = [0][:0]
    places, _ = _places(extension, squares.pitch)
    for place in places:
        for k in range(3):
            low, high = near(squares, place, k)
            for m in range(low, high):
                j, (x, y, _, reach) = squares.member[m], squares.around[m]
                room = needle.shaft_mm + extension.radius + reach
                if (
                    since <= when[j] < NEVER
                    and flat_gap(x, y, extension.start, extension.tip, 0.0, 1.0) < room
                    and meets(j, extension, elements, meetings, needle)
                ):
                    met.append(j)
    return np.unique(np.array(met, np.int64))


@jit
def _places(extension: Extension, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Places along it, its tip last, no further apart than the spacing; ways along the vessel."""
    way = extension.tip - extension.start
    length = np.sqrt((way * way).sum())
    count = int(np.ceil(length / spacing))
    places, along = np.empty((count, 3)), np.empty(count)
    for k in range(count):
        places[k] = extension.start + way * ((k + 1.0) / count)
        along[k] = extension.at + extension.step * length * ((k + 1.0) / count)
    return places, along


@jit
def meets(
    i: int, extension: Extension, elements: Elements, meetings: Meetings, needle: Needle
) -> bool:
    """Whether the shaft passes through an extension's ink while element i is written."""
    thick = max(elements.radius[i, 0], elements.radius[i, 1])
    reach = joint_reach(needle, max(thick, extension.radius))
    vessel, radius = elements.vessel[i], extension.radius
    top = max(extension.start[2], extension.tip[2]) + radius
    for k in range(TIPS):
        tip, at = tip_along(i, k, elements)
        wide = radius_at(needle, max(top - tip[2], 0.0)) + radius
        gap = flat_gap(tip[0], tip[1], extension.start, extension.tip, 0.0, 1.0)
        if top <= tip[2] or gap >= wide:
            continue
        places, ways = _places(extension, 0.25 * needle.tip_mm)
        for n in range(len(ways)):
            ink = places[n]
            height = ink[2] + radius - tip[2]
            across = np.hypot(ink[0] - tip[0], ink[1] - tip[1])
            if height <= 0.0 or across >= radius_at(needle, height) + radius:
                continue
            if not of_one_joint(
                vessel, at, extension.vessel, ways[n], reach, meetings, extension.far
            ):
                return True
    return False


class ChosenExtensions(NamedTuple):
    """Extensions chosen so far, ``size[0]`` of them."""

    place: FloatArray  # (n, 2, 3), start and tip, mm
    value: FloatArray  # (n, 4), radius, at, step and far of `Extension`
    number: IntArray  # (n, 3), vessel, element, and when it is written
    size: IntArray  # (1,)


def empty_extensions(count: int) -> ChosenExtensions:
    """Return space for so many extensions."""
    places, values = np.zeros((count, 2, 3)), np.zeros((count, 4))
    return ChosenExtensions(places, values, np.zeros((count, 3), np.int64), np.zeros(1, np.int64))


def add_extension(kept: ChosenExtensions, extension: Extension, element: int, when: int) -> None:
    """Add one."""
    row = int(kept.size[0])
    kept.place[row] = extension.start, extension.tip
    kept.value[row] = extension.radius, extension.at, extension.step, extension.far
    kept.number[row] = extension.vessel, element, when
    kept.size[0] += 1


@jit
def crossing_extension(
    extension: Extension, when: int, kept: ChosenExtensions, meetings: Meetings, needle: Needle
) -> int:
    """Element of a kept extension of which one's shaft meets the other's ink; -1 for none."""
    for row in range(kept.size[0]):
        start, tip = kept.place[row, 0], kept.place[row, 1]
        room = needle.shaft_mm + extension.radius + kept.value[row, 0]
        room += np.hypot(tip[0] - start[0], tip[1] - start[1])
        room += np.hypot(
            extension.tip[0] - extension.start[0], extension.tip[1] - extension.start[1]
        )
        apart = np.hypot(start[0] - extension.start[0], start[1] - extension.start[1])
        if apart >= room or kept.number[row, 2] == when:
            continue
        other = Extension(
            start, tip, kept.value[row, 0], kept.number[row, 0], kept.value[row, 1],
            int(kept.value[row, 2]), kept.value[row, 3],
        )  # fmt: skip
        if kept.number[row, 2] < when:
            meets_ink = _enters(extension, other, meetings, needle)
        else:
            meets_ink = _enters(other, extension, meetings, needle)
        if meets_ink:
            return int(kept.number[row, 1])
    return -1


@jit
def _enters(later: Extension, earlier: Extension, meetings: Meetings, needle: Needle) -> bool:
    """Whether the shaft that writes one extension passes through the ink of another."""
    reach = joint_reach(needle, max(later.radius, earlier.radius))
    tips, tip_ways = _places(later, 0.25 * needle.tip_mm)
    places, ways = _places(earlier, 0.25 * needle.tip_mm)
    for k in range(len(tip_ways)):
        for n in range(len(ways)):
            tip, ink = tips[k], places[n]
            across = np.hypot(ink[0] - tip[0], ink[1] - tip[1])
            if off_shaft(across, ink[2] - tip[2], needle) >= earlier.radius:
                continue
            if not of_one_joint(
                later.vessel,
                tip_ways[k],
                earlier.vessel,
                ways[n],
                reach,
                meetings,
                earlier.far,
                later.far,
            ):
                return True
    return False


PARTS = (1.0, 0.5, 0.25)
"""Of an overlap that are tried, the longest first."""
HALVINGS = 6
"""Of the range of needles in which one that closes an open joint is looked for: to 2 %."""


@dataclass(frozen=True)
class _End:
    """One end of a pass: the pass, whether its last point, and the element there."""

    number: int
    last: bool
    element: int


@dataclass(frozen=True)
class _Extended:
    """An end carried on: the ink that its shaft meets, and later elements whose shaft meets it."""

    end: _End
    extension: Extension
    barred: list[BrushedOverlap]
    brushed: list[BrushedOverlap]

    @property
    def length(self) -> float:
        """How far it goes on, mm."""
        return float(np.linalg.norm(self.extension.tip - self.extension.start))

    @property
    def free(self) -> bool:
        return not self.barred and not self.brushed

    @property
    def harmless(self) -> bool:
        """Whether needle and ink come no nearer than the needle itself needs."""
        return not any(one.entered for one in self.barred + self.brushed)


@dataclass(frozen=True)
class Joiner:
    """Closes the joints of ordered passes."""

    elements: Elements
    squares: Squares
    meetings: Meetings
    needle: Needle
    strict: bool = False  # a joint rather stays open than that the needle enters its overlap

    def join(self, passes: list[Pass], explain: bool = False) -> JoinedPasses:
        """Close what can be closed; with ``explain`` also find what would close open joints."""
        return _Round(self, passes, explain).join()


class _Round:
    """One order of passes being joined."""

    def __init__(self, joiner: Joiner, passes: list[Pass], explain: bool) -> None:
        self._scene, self._elements, self._passes = joiner, joiner.elements, passes
        self._explain = explain
        self._out = JoinedPasses(np.zeros(len(passes)), np.zeros(len(passes)))
        self._when = np.full(len(joiner.elements.end), NEVER, dtype=np.int64)
        for number, one in enumerate(passes):
            self._when[one.elements()] = number
        self._kept = empty_extensions(2 * len(joiner.elements.end) + 2)
        self._ends: dict[int, list[_End]] = {}  # passes that end at each point
        self._inked: dict[int, int] = {}  # the element last written at each point

    def join(self) -> JoinedPasses:
        for number, one in enumerate(self._passes):
            order, points = one.elements().tolist(), self._points(one)
            self._out.through += len(one.legs) - 1
            self._out.joints += len(one.legs) - 1
            self._meet(_End(number, False, order[0]), points[0])
            for point, element in zip(points[1:-1], order[1:], strict=True):
                if point in self._inked:
                    self._go_through(element, point)
                self._inked[point] = element
            self._meet(_End(number, True, order[-1]), points[-1])
        return self._out

    def _points(self, one: Pass) -> list[int]:
        """Points that a pass goes through, one more than its elements."""
        points: list[int] = []
        for leg in one.legs:
            side = (0, 1) if leg.step > 0 else (1, 0)
            ends = self._elements.end[leg.elements()]
            points += ends[:, side[0]].tolist()
        return [*points, int(ends[-1, side[1]])]

    def _meet(self, end: _End, point: int) -> None:
        """A pass begins or ends at a point; where ink lies, it or an earlier one goes on."""
        ends = self._ends.setdefault(point, [])
        if point in self._inked:
            self._close([end, *reversed(ends)], point, end.element)
        ends.append(end)
        self._inked[point] = end.element

    def _go_through(self, element: int, point: int) -> None:
        """A pass goes through a point where ink lies: what ended there must reach beyond it."""
        earlier, out = self._ends.get(point, []), self._out
        reached = any((out.beyond if e.last else out.before)[e.number] > 0.0 for e in earlier)
        if reached or not earlier:
            out.joints += 1
            out.overlapped += 1
        else:
            self._close(earlier[::-1], point, element)

    def _close(self, sides: list[_End], point: int, later: int) -> None:
        """Carry the first of `sides` that can be on beyond a point, reached by element `later`."""
        out, earlier = self._out, self._inked[point]
        out.joints += 1
        reach = self._scene.needle.overlap_radii * min(self._radius(later), self._radius(earlier))
        if reach == 0.0:
            return
        whole: list[_Extended] = []
        for side in sides:
            whole.append(self._extended(side, point, reach))
            if whole[-1].free:
                break
        chosen: _Extended | None = whole[-1]
        if not whole[-1].free:
            self._request_reordering(whole[0], later)
            chosen = self._harmless(whole, sides, point, reach)
            if chosen is None and not self._scene.strict:
                chosen = self._least_brushed(whole)
        part = 0.0 if chosen is None else chosen.length / reach
        if part < PARTS[-1] / 2:
            weak = self._weak(later, earlier, point, 0.0)
            out.open.append(self._why(weak, sides, point, reach) if self._explain else weak)
        elif part < 1.0 - PARTS[-1] / 2:
            out.shortened.append(self._weak(later, earlier, point, part))
        if chosen is not None:
            self._keep(chosen)

    def _weak(self, later: int, earlier: int, point: int, part: float) -> WeakJoint:
        vessel = self._elements.vessel
        x, y, z = self._elements.point[point].tolist()
        return WeakJoint(int(vessel[later]), int(vessel[earlier]), (x, y, z), part)

    def _why(self, weak: WeakJoint, sides: list[_End], point: int, reach: float) -> WeakJoint:
        """The joint with what bars it, and the widest needle found with which a part closes it."""
        needle, least = self._scene.needle, PARTS[-1] * reach
        low, high = 0.0, needle.bare_mm
        bars = self._barring(sides, point, least, needle)
        for _ in range(HALVINGS):
            radius = (low + high) / 2
            still = self._barring(sides, point, least, needle.thinner(radius))
            low, high = (low, radius) if still else (radius, high)
            bars = still or bars
        vessel = int(self._elements.vessel[bars[0]]) if bars else -1
        apart = needle.bare_mm - low if low > 0.0 else 0.0
        return replace(weak, barred_by=vessel, needle_mm=2 * low, apart_mm=apart)

    def _barring(self, sides: list[_End], point: int, reach: float, needle: Needle) -> list[int]:
        """Elements of which needle or ink bars each side, of the one that fewest do."""
        elements = []
        for side in sides:
            one = self._extended(side, point, reach, needle)
            own = [bar.end for bar in one.barred if bar.entered]
            elements.append(own + [bar.element for bar in one.brushed if bar.entered])
        return min(elements, key=len)

    def _radius(self, element: int) -> float:
        return float(self._elements.radius[element].max())

    def _extended(
        self, end: _End, point: int, reach: float, needle: Needle | None = None
    ) -> _Extended:
        """What an end would meet if it went on beyond its point; with another needle, if given."""
        elements, element, scene = self._elements, end.element, self._scene
        needle = needle or scene.needle
        tail, head = elements.end[element].tolist()
        here, inner = elements.point[point], elements.point[tail if head == point else head]
        way = here - inner
        extension = Extension(
            here,
            here + reach * way / np.linalg.norm(way),
            self._radius(element),
            int(elements.vessel[element]),
            float(elements.arc[element] + (elements.length[element] if head == point else 0.0)),
            1 if head == point else -1,
            self._far(element, head == point),
        )
        about = self._when, elements, scene.squares, scene.meetings, needle
        now = end.number + end.last
        bars = barring(extension, now, *about)
        bare = (*about[:-1], needle.bare())
        entered = set(barring(extension, now, *bare).tolist()) if len(bars) else set()
        brushes = barred(extension, now, *about).tolist() if not entered else []
        met = [BrushedOverlap(element, k, k in entered) for k in bars.tolist()]
        order = 2 * end.number + end.last
        other = crossing_extension(extension, order, self._kept, scene.meetings, needle.bare())
        if other >= 0:
            met.append(BrushedOverlap(element, int(other), True))
        return _Extended(
            end,
            extension,
            met,
            [self._brushed(k, end, extension, needle) for k in brushes],
        )

    def _far(self, element: int, ahead: bool) -> float:
        """Way along its vessel to the end behind a vessel's last element, mm; inf within one."""
        elements = self._elements
        vessel = int(elements.vessel[element])
        first, last = int(elements.first[vessel]), int(elements.first[vessel + 1]) - 1
        if element != (last if ahead else first):
            return np.inf
        return 0.0 if ahead else float(elements.arc[last] + elements.length[last])

    def _brushed(
        self, later: int, end: _End, extension: Extension, needle: Needle
    ) -> BrushedOverlap:
        meetings = self._scene.meetings
        entered = meets(later, extension, self._elements, meetings, needle.bare())
        return BrushedOverlap(int(later), end.element, entered)

    def _harmless(
        self, whole: list[_Extended], sides: list[_End], point: int, reach: float
    ) -> _Extended | None:
        """One that later passes graze at most, or else the longest part for which there is room."""
        for one in whole:
            if one.harmless:
                return one
        for part in PARTS[1:]:
            for side in sides:
                one = self._extended(side, point, part * reach)
                if one.harmless:
                    return one
        return None

    def _least_brushed(self, whole: list[_Extended]) -> _Extended | None:
        """The one that fewest later elements brush, of those that nothing bars."""
        open_to = [one for one in whole if not any(bar.entered for bar in one.barred)]
        return min(open_to, key=lambda one: len(one.brushed), default=None)

    def _request_reordering(self, one: _Extended, later: int) -> None:
        """What would have to be written in another order."""
        self._out.reorderings += [(later, bar.end) for bar in one.barred]
        self._out.reorderings += [(brush.element, brush.end) for brush in one.brushed]

    def _keep(self, one: _Extended) -> None:
        out, end = self._out, one.end
        far = out.beyond if end.last else out.before
        far[end.number] = max(far[end.number], one.length)
        out.overlapped += 1
        add_extension(self._kept, one.extension, end.element, 2 * end.number + end.last)
        out.brushed += one.barred + one.brushed
