"""Track unwritten stretches of vessels, and test if each can be written in one stroke."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from design.toolpath.embedded.walk import Progress, undo_write, write_stretch
from kernels import jit
from kernels.arrays import IntArray

WHOLE: Final = -1
UNKNOWN: Final = -2


class Stretches(NamedTuple):
    """Where stretches may be begun: start ``2 e`` goes on from element e, ``2 e + 1`` backward.

    Attributes
    ----------
    live : (2 n,) int64
        Starts of unwritten stretches, ``size[0]`` of them in no order.
    place : (2 n,) int64
        Of each start in `live`; -1 for those that aren't there.
    size : (1,) int64
    stop : (2 n,) int64
        Element at which a stretch would have to wait: `WHOLE` for none, `UNKNOWN` before a look.
    until : (2 n,) int64
        Count at the stop's `Progress.waiting` of which another look is worth it.
    """

    live: IntArray
    place: IntArray
    size: IntArray
    stop: IntArray
    until: IntArray


def none_open(count: int) -> Stretches:
    """No stretch of so many elements."""
    empty = np.full(2 * count, -1, dtype=np.int64)
    return Stretches(empty, empty.copy(), np.zeros(1, np.int64), empty.copy(), empty.copy())


@jit
def step_of(start: int) -> int:
    """1 where a start leads on along its vessel, -1 where against it."""
    return 1 if start % 2 == 0 else -1


@jit
def vertex(element: int, step: int, outer: bool, elements: Elements) -> int:
    """Point where an element begins (outer) or ends, gone through by `step`."""
    return elements.end[element, 0 if (step > 0) == outer else 1]


@jit
def open_stretch(low: int, high: int, stretches: Stretches) -> None:
    """Let elements ``low`` to ``high - 1`` be begun from either end."""
    for start in (2 * low, 2 * (high - 1) + 1):
        stretches.stop[start] = UNKNOWN
        if stretches.place[start] < 0:
            stretches.place[start] = stretches.size[0]
            stretches.live[stretches.size[0]] = start
            stretches.size[0] += 1


@jit
def close_start(start: int, stretches: Stretches) -> None:
    """Take a start out of those that are live."""
    at = stretches.place[start]
    if at < 0:
        return
    stretches.size[0] -= 1
    last = stretches.live[stretches.size[0]]
    stretches.live[at], stretches.place[last] = last, at
    stretches.place[start] = -1


@jit
def close_written(first: int, last: int, progress: Progress, elements: Elements,
                  stretches: Stretches) -> None:  # fmt: skip
    """Elements ``first`` to ``last`` have been written: open what is left on either side."""
    vessel = elements.vessel[first]
    low, high = first, last + 1
    while low > elements.first[vessel] and not progress.written[low - 1]:
        low -= 1
    while high < elements.first[vessel + 1] and not progress.written[high]:
        high += 1
    close_start(2 * low, stretches)
    close_start(2 * (high - 1) + 1, stretches)
    if low < first:
        open_stretch(low, first, stretches)
    if last + 1 < high:
        open_stretch(last + 1, high, stretches)


@jit
def is_whole(start: int, elements: Elements, rules: Rules, progress: Progress,
             stretches: Stretches) -> bool:  # fmt: skip
    """Whether a stretch can be written to its end; looked at again when it may have changed."""
    stop = stretches.stop[start]
    if stop == WHOLE:
        return True
    if stop >= 0 and progress.waiting[stop] > stretches.until[start]:
        return False
    count, stop = write_stretch(start // 2, step_of(start), elements, rules, progress)
    inside = progress.waiting[stop] if stop >= 0 else 0
    undo_write(start // 2, step_of(start), count, rules, progress)
    stretches.stop[start] = stop
    if stop >= 0:
        # What the stretch itself would have set free before it came there doesn't count.
        stretches.until[start] = progress.waiting[stop] - inside
    return stop == WHOLE
