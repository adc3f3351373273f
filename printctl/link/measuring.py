"""Asks the machine for what its profile has watched (a plunger's force, a pressure), in a print.

A question is a command between two lines like a checkpoint's: it has a number, is in the journal
before it is sent, and its answer is matched by that number; the job's lines are held meanwhile.
The answer itself has no checksum. So a reading above the limit is asked for once more before the
print is ended for it, and one that can't be read is an alarm only when that goes on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from firmware_profiles import Watched
from printctl.link.channel import Wiring
from printctl.link.errors import HandshakeError
from printctl.link.job import Job
from printctl.link.placing import Placing
from printctl.link.states import Status

UNREADABLE: Final = 3
"""So many answers running that can't be read are an alarm."""


class Gauge:
    """One watched quantity: its last reading, and when it is next asked for.

    Parameters
    ----------
    watched : Watched

    Attributes
    ----------
    value : float
        Last reading; nan before the first.
    due : float, s
        When to ask again.
    unread : int
        Answers since then that couldn't be read.
    """

    def __init__(self, watched: Watched) -> None:
        self.watched = watched
        self.value, self.due, self.unread = math.nan, 0.0, 0
        self._number = re.compile(watched.regex)

    def read(self, replies: Sequence[bytes]) -> float:
        """Find the number in an answer; nan where it isn't there."""
        for text in replies:
            found = self._number.search(text.decode("latin-1"))
            value = _number(found[1]) if found and found[1] else math.nan
            if not math.isnan(value):
                self.value, self.unread = value, 0
                return value
        self.unread += 1
        return math.nan

    def __str__(self) -> str:
        watched = self.watched
        now = "not read yet" if math.isnan(self.value) else f"{self.value:g} {watched.unit}"
        return f"{watched.query}: {now}, at most {watched.high:g} {watched.unit}"


class Measuring(Placing):
    """Knows what is to be asked; see `Placing` for what it is given."""

    def __init__(self, wiring: Wiring, job: Job) -> None:
        super().__init__(wiring, job)
        self._gauges = [Gauge(watched) for watched in wiring.printer.watch]

    @property
    def status(self) -> Status:
        """The print as it stands."""
        return replace(super().status, readings=tuple(str(gauge) for gauge in self._gauges))

    def _note(self, now: float) -> None:
        super()._note(now)
        soon = min((gauge.due for gauge in self._gauges), default=math.inf)
        self._next_note = min(self._next_note, max(soon, now))

    def _gauge_due(self, now: float) -> bool:
        return any(now >= gauge.due for gauge in self._gauges)

    def _too_high(self, now: float) -> str:
        """Ask for what is due; say which reading is above its limit, twice; empty for none."""
        for gauge in self._gauges:
            if now >= gauge.due and self._above(gauge) and self._above(gauge):
                return f"{self._compared(gauge)} (printer: watch)"
        return ""

    def _above(self, gauge: Gauge) -> bool:
        """Ask once. What was above and can't be read then counts as above."""
        before = gauge.value > gauge.watched.high
        value = self._read(gauge)
        return before if math.isnan(value) else value > gauge.watched.high

    def _read(self, gauge: Gauge, journalled: bool = True) -> float:
        watched = gauge.watched
        replies = self._command(watched.query.encode("ascii"), journalled)
        gauge.due = self.wiring.clock.now() + watched.every_s
        value = gauge.read(replies)
        if math.isnan(value):
            if gauge.unread == UNREADABLE:
                self._alarm(f"{UNREADABLE} answers to {watched.query} running can't be read")
            return value
        self._record("reading", query=watched.query, value=value, unit=watched.unit)
        return value

    def _check_at_rest(self) -> None:
        """Refuse to begin where something can't be read, or is at its limit already."""
        for gauge in self._gauges:
            for _ in range(UNREADABLE):
                if not math.isnan(self._read(gauge, journalled=False)):
                    break
            else:
                raise HandshakeError(
                    f"{gauge.watched.query} isn't answered by what its regex "
                    f"{gauge.watched.regex!r} reads; mend the profile (watch) or the machine"
                )
            if gauge.value >= gauge.watched.high:
                raise HandshakeError(
                    f"at rest, before the first line, {self._compared(gauge)}; relieve what "
                    "presses there, or mend the profile (watch)"
                )

    @staticmethod
    def _compared(gauge: Gauge) -> str:
        watched = gauge.watched
        return (
            f"{watched.query} reads {gauge.value:g} {watched.unit}, its limit is "
            f"{watched.high:g} {watched.unit}"
        )


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
