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
from dataclasses import dataclass
from typing import Final

from firmware_profiles import WatchedGauge
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.steps import Steps
from printctl.machine.errors import HandshakeError

MAX_UNREAD: Final = 3
"""So many answers running that can't be read are an alarm."""


@dataclass
class Gauge:
    """One watched quantity: its last reading, and when it is next asked for."""

    watched: WatchedGauge
    value: float = math.nan
    due: float = 0.0  # s: when to ask again
    unread: int = 0  # answers since the last reading that couldn't be read

    def __str__(self) -> str:
        watched = self.watched
        now = "not read yet" if math.isnan(self.value) else f"{self.value:g} {watched.unit}"
        return f"{watched.query}: {now}, maximum {watched.high:g} {watched.unit}"

    @property
    def compared(self) -> str:
        """The reading and its limit, in words."""
        high, unit = self.watched.high, self.watched.unit
        return f"{self.watched.query} reads {self.value:g} {unit}, its limit is {high:g} {unit}"


def next_due(gauges: Sequence[Gauge]) -> float:
    """Return when the next question is due, s; infinite for never."""
    return min((gauge.due for gauge in gauges), default=math.inf)


def read_gauge(channel: Channel, gauge: Gauge, journalled: bool = True) -> Steps[float]:
    """Ask for a gauge's value; nan where the answer can't be read."""
    watched, logbook = gauge.watched, channel.logbook
    replies = yield from channel.command(watched.query.encode("ascii"), journalled)
    gauge.due = channel.now + watched.every_s
    matches = (re.search(watched.regex, text.decode("latin-1")) for text in replies)
    values = (_number(match[1]) for match in matches if match and match[1])
    value = next((value for value in values if not math.isnan(value)), math.nan)
    if math.isnan(value):
        gauge.unread += 1
        if gauge.unread == MAX_UNREAD:
            logbook.alarm(f"{MAX_UNREAD} consecutive replies to {watched.query} can't be read")
        return value
    gauge.value, gauge.unread = value, 0
    logbook.record("reading", query=watched.query, value=value, unit=watched.unit)
    return value


def read_high(channel: Channel, gauges: Sequence[Gauge], now: float) -> Steps[str]:
    """Ask for what is due; say which reading is above its limit, twice; empty for none."""
    for gauge in gauges:
        if now < gauge.due or not (yield from _is_above(channel, gauge)):
            continue
        if (yield from _is_above(channel, gauge)):
            return f"{gauge.compared} (printer: watch)"
    return ""


def check_at_rest(channel: Channel, gauges: Sequence[Gauge]) -> Steps[None]:
    """Refuse to begin where something can't be read, or is at its limit already."""
    for gauge in gauges:
        for _ in range(MAX_UNREAD):
            if not math.isnan((yield from read_gauge(channel, gauge, journalled=False))):
                break
        else:
            raise HandshakeError(
                f"{gauge.watched.query} gets no reply that matches its regex "
                f"{gauge.watched.regex!r}; correct the profile (watch) or the printer"
            )
        if gauge.value >= gauge.watched.high:
            raise HandshakeError(
                f"at rest, before the first line, {gauge.compared}; release the load on the "
                "sensor, or correct the profile (watch)"
            )


def _is_above(channel: Channel, gauge: Gauge) -> Steps[bool]:
    """Ask once. What was above and can't be read then counts as above."""
    high = gauge.watched.high
    before = gauge.value > high
    value = yield from read_gauge(channel, gauge)
    return before if math.isnan(value) else value > high


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
