"""Mark a row of vessel elements as written, up to one that must wait or is already written."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.rules import Rules
from kernels import jit
from kernels.arrays import IntArray


class Leg(NamedTuple):
    """Elements of one vessel written in a row: ``element``, then ``size - 1`` more by ``step``."""

    element: int
    step: int
    size: int

    @property
    def last(self) -> int:
        """The element it ends with."""
        return self.element + self.step * (self.size - 1)

    @property
    def middle(self) -> int:
        """Its first and last element's sum: the same whichever way it is written."""
        return self.element + self.last

    def elements(self) -> IntArray:
        """Numbers of all, in order."""
        return self.element + self.step * np.arange(self.size)


class Progress(NamedTuple):
    """What is written, and for how many unwritten elements each still waits.

    Attributes
    ----------
    written : (n,) bool
    waiting : (n,) int64
        At most 0 where an element may be written.
    """

    written: NDArray[np.bool_]
    waiting: IntArray


def start_walk(rules: Rules, out: NDArray[np.bool_] | None = None) -> Progress:
    """Nothing written yet; elements that are ``out`` (n,) count as written, and have no rules."""
    count = len(rules.begin) - 1
    waiting = np.bincount(rules.after, minlength=count)
    written = np.zeros(count, dtype=np.bool_) if out is None else out.copy()
    return Progress(written, waiting)


@jit
def write_stretch(
    element: int, step: int, elements: Elements, rules: Rules, progress: Progress
) -> tuple[int, int]:
    """Write from an element on until the vessel ends, or ink, or what must wait.

    Returns how many, and the element that must wait; -1 where none stands in the way. What is
    written is marked in `progress`; `undo_write` takes it back.
    """
    vessel = elements.vessel[element]
    low, high = elements.first[vessel], elements.first[vessel + 1]
    count, here = 0, element
    while low <= here < high and not progress.written[here]:
        if progress.waiting[here] > 0:
            return count, here
        progress.written[here] = True
        for k in range(rules.begin[here], rules.begin[here + 1]):
            progress.waiting[rules.after[k]] -= 1
        count += 1
        here += step
    return count, -1


@jit
def undo_write(element: int, step: int, count: int, rules: Rules, progress: Progress) -> None:
    """Take back what `write_stretch` wrote."""
    for n in range(count):
        here = element + step * n
        progress.written[here] = False
        for k in range(rules.begin[here], rules.begin[here + 1]):
            progress.waiting[rules.after[k]] += 1
