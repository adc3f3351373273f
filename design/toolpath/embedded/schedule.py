"""The order of writing: few passes, short ways, nothing in the shaft's way.

What is written never bars anything else, it only sets free; so a stretch that can be written from
end to end may be written at once, and one that can't had better wait. Where all wait for each
other one must be cut: the one whose part sets most others free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.walk import Leg, Progress, begun, unwalk, walk
from design.toolpath.toolpath import FloatArray, IntArray

TRIED = 64
"""Cuts that are tried where all wait for each other."""


@dataclass(frozen=True)
class Pass:
    """Stretches written without lifting the needle."""

    legs: tuple[Leg, ...]

    def elements(self) -> IntArray:
        """Numbers of all, in order."""
        return np.concatenate([leg.elements() for leg in self.legs])


@dataclass
class _Start:
    """Where a stretch may be begun: an element, and the way along the vessel.

    `stop` is the element at which it would have to wait (-1: it can be written to its end), and
    `until` the count at `waiting` of which it is worth another look.
    """

    element: int
    step: int
    stop: int = -2
    until: int = 0


class Scheduler:
    """Finds an order for all elements.

    Parameters
    ----------
    elements : Elements
    rules : Rules
    head : (v,) int64
        The head that writes each vessel.
    """

    def __init__(self, elements: Elements, rules: Rules, head: IntArray) -> None:
        self.elements, self.rules, self.head = elements, rules, head
        self.progress: Progress = begun(rules)
        self.passes: list[Pass] = []
        self._starts: dict[tuple[int, int], _Start] = {}
        self._at: dict[int, set[tuple[int, int]]] = {}
        for low, high in zip(
            elements.first[:-1].tolist(), elements.first[1:].tolist(), strict=True
        ):
            self._open(low, high)

    def run(self) -> list[Pass]:
        """Order all; the passes, one after another."""
        tip, tool = self._lowest(), int(self.head.min())
        while self._starts:
            chosen = self._nearest_whole(tip, tool) or self._cut(tip, tool)
            legs = self._extended(chosen)
            self._commit(legs)
            tip = self._point(legs[-1].last, legs[-1].step, outer=False)
            tool = int(self.head[self.elements.vessel[legs[-1].element]])
        return self.passes

    # Stretches

    def _open(self, low: int, high: int) -> None:
        """Elements ``low`` to ``high - 1`` of a vessel are to be written, from either end."""
        for element, step in ((low, 1), (high - 1, -1)):
            key = (element, step)
            self._starts[key] = _Start(element, step)
            self._at.setdefault(self._vertex(element, step, outer=True), set()).add(key)

    def _close(self, key: tuple[int, int]) -> None:
        start = self._starts.pop(key)
        self._at[self._vertex(start.element, start.step, outer=True)].discard(key)

    def _vertex(self, element: int, step: int, *, outer: bool) -> int:
        """The point where an element begins (outer) or ends, gone through by `step`."""
        return int(self.elements.end[element, 0 if (step > 0) == outer else 1])

    def _point(self, element: int, step: int, *, outer: bool) -> FloatArray:
        return self.elements.point[self._vertex(element, step, outer=outer)]

    def _lowest(self) -> FloatArray:
        return self.elements.point[int(np.argmin(self.elements.point[:, 2]))]

    # Choice

    def _is_whole(self, start: _Start) -> bool:
        """Whether a stretch can be written to its end; looked at again when it may have changed."""
        if start.stop == -1:
            return True
        if start.stop >= 0 and self.progress.waiting[start.stop] > start.until:
            return False
        count, stop = walk(start.element, start.step, self.elements, self.rules, self.progress)
        start.stop = stop
        inside = int(self.progress.waiting[stop]) if stop >= 0 else 0
        unwalk(start.element, start.step, count, self.rules, self.progress)
        if stop >= 0:
            start.until = int(self.progress.waiting[stop]) - inside
        return stop == -1

    def _nearest_whole(self, tip: FloatArray, tool: int) -> _Start | None:
        waiting = self.progress.waiting
        whole = [
            start
            for start in self._starts.values()
            if start.stop == -1
            or ((start.stop < 0 or waiting[start.stop] <= start.until) and self._is_whole(start))
        ]
        return self._nearest(whole, tip, tool)

    def _nearest(self, starts: list[_Start], tip: FloatArray, tool: int) -> _Start | None:
        if not starts:
            return None
        own = [s for s in starts if self.head[self.elements.vessel[s.element]] == tool]
        starts = own or starts
        where = np.array([self._point(s.element, s.step, outer=True) for s in starts])
        return starts[int(np.argmin(((where - tip) ** 2).sum(axis=1)))]

    # Passes

    def _extended(self, start: _Start) -> list[Leg]:
        """The stretch, and those that go on from where it ends; all are marked as written."""
        count, stop = walk(start.element, start.step, self.elements, self.rules, self.progress)
        legs = [Leg(start.element, start.step, count)]
        while stop == -1:
            leg = self._going_on(legs)
            if leg is None:
                break
            legs.append(leg)
        return legs

    def _going_on(self, legs: list[Leg]) -> Leg | None:
        """The straightest stretch that begins where the last one ends and can be written whole."""
        last = legs[-1]
        node = self._vertex(last.last, last.step, outer=False)
        vessel = self.elements.vessel[last.element]
        options = [
            self._starts[key]
            for key in sorted(self._at.get(node, ()))
            if not self.progress.written[key[0]]
            and self.head[self.elements.vessel[key[0]]] == self.head[vessel]
        ]
        way = self._direction(last.last, last.step)
        options.sort(key=lambda s: -float(way @ self._direction(s.element, s.step)))
        for start in options:
            count, stop = walk(start.element, start.step, self.elements, self.rules, self.progress)
            if stop == -1 and count:
                return Leg(start.element, start.step, count)
            unwalk(start.element, start.step, count, self.rules, self.progress)
        return None

    def _direction(self, element: int, step: int) -> FloatArray:
        way = self._point(element, step, outer=False) - self._point(element, step, outer=True)
        return np.asarray(way / np.linalg.norm(way))

    def _commit(self, legs: list[Leg]) -> None:
        """Keep a pass; what is left of the stretches it was cut out of stays to be written."""
        self.passes.append(Pass(tuple(legs)))
        for leg in legs:
            vessel = int(self.elements.vessel[leg.element])
            first, last = sorted((leg.element, leg.last))
            low, high = self._stretch(first, last, vessel)
            for key in ((low, 1), (high - 1, -1)):
                if key in self._starts:
                    self._close(key)
            if low < first:
                self._open(low, first)
            if last + 1 < high:
                self._open(last + 1, high)

    def _stretch(self, first: int, last: int, vessel: int) -> tuple[int, int]:
        """The unwritten elements around those just written, which were one with them."""
        written = self.progress.written
        low, high = first, last + 1
        while low > self.elements.first[vessel] and not written[low - 1]:
            low -= 1
        while high < self.elements.first[vessel + 1] and not written[high]:
            high += 1
        return low, high

    # Cuts

    def _cut(self, tip: FloatArray, tool: int) -> _Start:
        """Where all wait for each other: the part that sets most stretches free."""
        parts = self._parts()
        if not parts:
            parts = [self._forced()]
        if len(parts) > TRIED:
            low = np.array([self._point(p.element, p.step, outer=True)[2] for p in parts])
            parts = [parts[k] for k in np.argsort(low, kind="stable")[:TRIED]]
        waiting = [start for start in self._starts.values() if start.stop >= 0]
        stop = np.array([start.stop for start in waiting], dtype=np.int64)
        until = np.array([start.until for start in waiting], dtype=np.int64)
        gain = [self._gain(part, waiting, stop, until) for part in parts]
        best = max(gain)
        chosen = self._nearest(
            [p for p, g in zip(parts, gain, strict=True) if g == best], tip, tool
        )
        assert chosen is not None
        return chosen

    def _parts(self) -> list[_Start]:
        """Starts from which at least one element can be written."""
        free = ~self.progress.written & (self.progress.waiting <= 0)
        vessel = self.elements.vessel
        goes_on = free[:-1] & free[1:] & (vessel[:-1] == vessel[1:])
        onward = np.flatnonzero(free & ~np.append(False, goes_on))
        backward = np.flatnonzero(free & ~np.append(goes_on, False))
        starts = [(e, 1) for e in onward.tolist()] + [(e, -1) for e in backward.tolist()]
        return [
            _Start(element, step) for element, step in sorted(starts, key=lambda s: (s[0], -s[1]))
        ]

    def _gain(
        self, part: _Start, waiting: list[_Start], stops: IntArray, until: IntArray
    ) -> tuple[int, int]:
        """How many stretches could be written whole after a part; less what the part leaves.

        ``waiting`` are those that wait, at their `stops` (k,), until so few are waited for.
        """
        count, stop = walk(part.element, part.step, self.elements, self.rules, self.progress)
        freed = 0
        for k in np.flatnonzero(self.progress.waiting[stops] <= until).tolist():
            other = waiting[k]
            if not self.progress.written[other.element]:
                freed += self._is_whole(_Start(other.element, other.step))
        unwalk(part.element, part.step, count, self.rules, self.progress)
        left = (stop >= 0) + ((part.element, part.step) not in self._starts)
        return freed - left, count

    def _forced(self) -> _Start:
        """The element that does the least harm written out of turn, where none may be written."""
        left = ~self.progress.written
        owner = np.repeat(np.arange(len(left)), np.diff(self.rules.begin))
        live = left[owner] & left[self.rules.after]
        harm = np.bincount(
            self.rules.after[live], weights=self.rules.harm[live], minlength=len(left)
        )
        element = int(np.flatnonzero(left)[np.argmin(harm[left])])
        self.progress.waiting[element] = -(1 << 40)
        return _Start(element, 1)
