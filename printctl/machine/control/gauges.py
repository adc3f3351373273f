"""Ask the printer for force and pressure readings during a print; compare them with limits.

A question is a command between two lines like a checkpoint's: it has a number, is in the journal
before it is sent, and its answer is matched by that number; the job's lines are held meanwhile.
The answer itself has no checksum. So a reading above the limit is asked for once more before the
print is ended for it, and one that can't be read is an alarm only when that goes on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from firmware_profiles import WatchedGauge
from printctl.machine.control.channel import Channel
from printctl.machine.errors import HandshakeError

UNREADABLE: Final = 3
"""So many answers running that can't be read are an alarm."""


class Gauge:
    """One watched quantity: its last reading, and when it is next asked for.

    Parameters
    ----------
    watched : WatchedGauge

    Attributes
    ----------
    value : float
        Last reading; nan before the first.
    due : float, s
        When to ask again.
    unread : int
        Answers since then that couldn't be read.
    """

    def __init__(self, watched: WatchedGauge) -> None:
        self.watched = watched
        self.value, self.due, self.unread = math.nan, 0.0, 0
        self._number = re.compile(watched.regex)

    def read(self, replies: Sequence[bytes]) -> float:
        """Find the number in an answer; nan where it isn't there."""
        for text in replies:
            match = self._number.search(text.decode("latin-1"))
            value = _number(match[1]) if match and match[1] else math.nan
            if not math.isnan(value):
                self.value, self.unread = value, 0
                return value
        self.unread += 1
        return math.nan

    def __str__(self) -> str:
        watched = self.watched
        now = "not read yet" if math.isnan(self.value) else f"{self.value:g} {watched.unit}"
        return f"{watched.query}: {now}, at most {watched.high:g} {watched.unit}"


class Gauges:
    """All that is watched of one printer.

    Parameters
    ----------
    channel : Channel
    gauges : sequence of Gauge
    """

    def __init__(self, channel: Channel, gauges: Sequence[Gauge]) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._gauges = gauges

    @property
    def readings(self) -> tuple[str, ...]:
        """Last readings, for a person."""
        return tuple(str(gauge) for gauge in self._gauges)

    @property
    def next_due(self) -> float:
        """When the next question is due, s; infinite for never."""
        return next_due(self._gauges)

    def too_high(self, now: float) -> str:
        """Ask for what is due; say which reading is above its limit, twice; empty for none."""
        for gauge in self._gauges:
            if now >= gauge.due and self._above(gauge) and self._above(gauge):
                return f"{_compared(gauge)} (printer: watch)"
        return ""

    def check_at_rest(self) -> None:
        """Refuse to begin where something can't be read, or is at its limit already.

        Raises
        ------
        HandshakeError
        """
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
                    f"at rest, before the first line, {_compared(gauge)}; relieve what "
                    "presses there, or mend the profile (watch)"
                )

    def _above(self, gauge: Gauge) -> bool:
        """Ask once. What was above and can't be read then counts as above."""
        before = gauge.value > gauge.watched.high
        value = self._read(gauge)
        return before if math.isnan(value) else value > gauge.watched.high

    def _read(self, gauge: Gauge, journalled: bool = True) -> float:
        watched = gauge.watched
        replies = self._channel.command(watched.query.encode("ascii"), journalled)
        gauge.due = self._channel.wiring.clock.now() + watched.every_s
        value = gauge.read(replies)
        if math.isnan(value):
            if gauge.unread == UNREADABLE:
                self._logbook.alarm(
                    f"{UNREADABLE} answers to {watched.query} running can't be read"
                )
            return value
        self._logbook.record("reading", query=watched.query, value=value, unit=watched.unit)
        return value


def next_due(gauges: Sequence[Gauge]) -> float:
    """Return when the next question is due, s; infinite for never."""
    return min((gauge.due for gauge in gauges), default=math.inf)


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
