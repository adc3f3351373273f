"""Schedule a simulated board's faults, each due once, by line, clock or bytes received."""

from __future__ import annotations

import math
from collections.abc import Iterable

from sim.devices.faults.fault_file import Fault


class FaultPlan:
    """Faults that are still to come; each comes once.

    Attributes
    ----------
    next_s : float, s
        When the next one by the clock is due; infinite for none.
    muted : set of int
        Lines whose ok will be lost.
    """

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        every = list(faults)
        self.muted: set[int] = set()
        self._by_line = {fault.line: fault for fault in every if fault.line is not None}
        timed = [(fault.time_s, fault) for fault in every if fault.time_s is not None]
        self._by_time = sorted(timed, key=lambda one: one[0], reverse=True)
        counted = [(fault.bytes, fault) for fault in every if fault.bytes is not None]
        self._by_bytes = sorted(counted, key=lambda one: one[0], reverse=True)

    @property
    def next_s(self) -> float:
        """See the class."""
        return self._by_time[-1][0] if self._by_time else math.inf

    @property
    def counts_bytes(self) -> bool:
        """Whether one waits for a number of bytes."""
        return bool(self._by_bytes)

    def has_line(self, number: int) -> bool:
        """Whether one waits for this line."""
        return number in self._by_line

    def at_line(self, number: int) -> Fault | None:
        """The one that waits for this line."""
        return self._by_line.pop(number, None)

    def is_mute(self, number: int | None) -> bool:
        """Whether a line's ok is to be lost; it is lost once."""
        mute = number in self.muted
        self.muted.discard(number or 0)
        return mute

    def due(self, now: float, received: int) -> Fault | None:
        """The next one that is due by clock (s) or bytes received."""
        if self._by_time and self._by_time[-1][0] <= now:
            return self._by_time.pop()[1]
        if self._by_bytes and self._by_bytes[-1][0] <= received:
            return self._by_bytes.pop()[1]
        return None
