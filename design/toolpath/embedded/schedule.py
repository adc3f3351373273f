"""Order vessel elements into few writing strokes, short travels, no ink in the shaft's way.

What is written never bars anything else, it only sets free; so a stretch that can be written from
end to end may be written at once, and one that can't had better wait. Where all wait for each
other one must be cut: the one whose part sets most others free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.cuts import best_cut
from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.stretches import (
    Stretches,
    close_written,
    is_whole,
    none_open,
    open_stretch,
    step_of,
    vertex,
)
from design.toolpath.embedded.trails import Ends, ends_of, first_of, going_on
from design.toolpath.embedded.walk import Leg, Progress, start_walk, write_stretch
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Pass:
    """Stretches written without lifting the needle."""

    legs: tuple[Leg, ...]

    def elements(self) -> IntArray:
        """Numbers of all, in order."""
        return np.concatenate([leg.elements() for leg in self.legs])


@dataclass(frozen=True)
class Scheduler:
    """Finds an order for all elements.

    Attributes
    ----------
    elements : Elements
    rules : Rules
    head : (v,) int64
        The head that writes each vessel.
    out : (n,) bool or None
        Elements of vessels that aren't written; no rule names them.
    """

    elements: Elements
    rules: Rules
    head: IntArray
    out: NDArray[np.bool_] | None = None

    def run(self) -> list[Pass]:
        """Order all; the passes, one after another."""
        elements, count = self.elements, len(self.elements.end)
        legs = _legs(
            elements,
            self.rules,
            self.head,
            ends_of(elements),
            start_walk(self.rules, self.out),
            none_open(count),
        )
        begin = np.flatnonzero(legs[:, 0])
        parts = np.split(legs[:, 1:], begin[1:])
        return [Pass(tuple(Leg(*leg) for leg in part.tolist())) for part in parts]


@jit
def _legs(elements: Elements, rules: Rules, head: IntArray, ends: Ends, progress: Progress,
          stretches: Stretches) -> IntArray:  # fmt: skip
    """Legs in their order, (k, 4): 1 where a pass begins, and those of `Leg`."""
    legs = [(0, 0, 0, 0)][:0]
    for vessel in range(len(elements.first) - 1):
        if not progress.written[elements.first[vessel]]:
            open_stretch(elements.first[vessel], elements.first[vessel + 1], stretches)
    tip = elements.point[np.argmin(elements.point[:, 2])].copy()
    tool = head.min()
    while stretches.size[0] > 0:
        start = _nearest_whole(tip, tool, head, elements, rules, progress, stretches)
        if start < 0:
            start = best_cut(tip, tool, head, elements, rules, progress, stretches)
        if start < 0:
            start = _forced(rules, progress)
        begin = len(legs)
        _extend(start, legs, ends, head, elements, rules, progress, stretches)
        for k in range(begin, len(legs)):
            _, element, step, size = legs[k]
            far = element + step * (size - 1)
            close_written(min(element, far), max(element, far), progress, elements, stretches)
        _, element, step, size = legs[-1]
        tip[:] = elements.point[vertex(element + step * (size - 1), step, False, elements)]
        tool = head[elements.vessel[element]]
    out = np.empty((len(legs), 4), np.int64)
    for k in range(len(legs)):
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = legs[k]
    return out


@jit
def _nearest_whole(tip: FloatArray, tool: int, head: IntArray, elements: Elements, rules: Rules,
                   progress: Progress, stretches: Stretches) -> int:  # fmt: skip
    """Start of the nearest stretch that can be written whole, this head's first; -1 for none."""
    best, least = -1, np.inf
    for k in range(stretches.size[0]):
        start = stretches.live[k]
        if not is_whole(start, elements, rules, progress, stretches):
            continue
        point = elements.point[vertex(start // 2, step_of(start), True, elements)]
        x, y, z = point[0] - tip[0], point[1] - tip[1], point[2] - tip[2]
        away = x * x + y * y + z * z
        if head[elements.vessel[start // 2]] != tool:
            away += 1e12
        if away < least or (away == least and start < best):
            best, least = start, away
    return best


@jit
def _extend(start: int, legs: list[tuple[int, int, int, int]], ends: Ends, head: IntArray,
            elements: Elements, rules: Rules, progress: Progress,
            stretches: Stretches) -> None:  # fmt: skip
    """Add a pass: what leads to a stretch, the stretch, and what goes on from where it ends."""
    stop, first = -1, 1
    for one in first_of(start, ends, head, elements, rules, progress, stretches):
        size, stop = write_stretch(one // 2, step_of(one), elements, rules, progress)
        legs.append((first, one // 2, step_of(one), size))
        first = 0
    while stop < 0:
        _, element, step, size = legs[-1]
        one, size = going_on(
            element + step * (size - 1), step, ends, head, elements, rules, progress
        )
        if one < 0:
            break
        legs.append((0, one // 2, step_of(one), size))


@jit
def _forced(rules: Rules, progress: Progress) -> int:
    """The element that does the least harm written out of turn, where none may be written."""
    harm = np.zeros(len(progress.written))
    for e in range(len(harm)):
        if not progress.written[e]:
            for k in range(rules.begin[e], rules.begin[e + 1]):
                harm[rules.after[k]] += rules.harm[k]
    best = -1
    for e in range(len(harm)):
        if not progress.written[e] and (best < 0 or harm[e] < harm[best]):
            best = e
    progress.waiting[best] = -(1 << 40)
    return 2 * best
