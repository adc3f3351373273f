"""Add to a print's status: gauges, inspection, pending pause or reload, dead-man's time left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from printctl.machine.control.gauges import Gauge, next_due
from printctl.machine.control.look_book import LookBook
from printctl.machine.control.syringe_change import SyringeChange
from printctl.machine.control.watch import Watch
from printctl.machine.job.marks import MarkKind
from printctl.machine.ports.clock import Clock
from printctl.machine.records.states import LinkState, Status


class PrintDetails:
    """Adds them to a status; changes nothing.

    Parameters
    ----------
    clock : Clock
    gauges : sequence of Gauge
    watch : Watch
    change : SyringeChange
    book : LookBook
    """

    def __init__(
        self,
        clock: Clock,
        gauges: Sequence[Gauge],
        watch: Watch,
        change: SyringeChange,
        book: LookBook,
    ) -> None:
        self._book = book
        self._clock, self._gauges = clock, gauges
        self._watch, self._change = watch, change

    def next_due(self) -> float:
        """Return when the next question to a gauge is due, s; infinite for never."""
        return next_due(self._gauges)

    def add(self, status: Status) -> Status:
        """Return the status of a print that goes on with all that is known."""
        left = self._watch.care.deadman_s or None  # it stands still in a pause
        if status.state is LinkState.PRINTING:
            left = self._watch.deadman_left(self._clock.now())
        return replace(
            status,
            readings=tuple(str(gauge) for gauge in self._gauges),
            waits_for=self._waits_for(status.state),
            deadman_left_s=left,
            look=self._book.told(),
        )

    def _waits_for(self, state: LinkState) -> str:
        look = self._book.current
        if state is LinkState.LOOKING and look is not None:
            return f"a decision on look {look.number}"
        if self._change.going_on:
            number = self._change.head
            return "syringe" if number is None else f"syringe {number}"
        after = self._watch.after
        if after is None:
            return ""
        return "reload" if after is MarkKind.RELOAD else f"pause after {after}"
