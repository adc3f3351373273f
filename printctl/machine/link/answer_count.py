"""Detect another program's lines to the printer: send a token at intervals, count oks before it."""

from __future__ import annotations

import math
from typing import Final

from printctl.machine.link.channel import Channel

EVERY_S: Final = 5.0
"""Interval of comparisons: each costs a line and its answer, while the planner goes on."""


class AnswerCount:
    """Notices lines that another program wrote to the printer.

    Such a line is answered by an ok that is taken for the next line's, and so on: from then on each
    ok is one line early. What the protocol asks to `confirm` shows it: one ok more comes before.

    Parameters
    ----------
    channel : Channel

    Attributes
    ----------
    next_due : float, s
        When they are compared next.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self.next_due, self._troubles = math.inf, 0

    def begin(self, now: float) -> None:
        """Compare for the first time a while after ``now``."""
        self.next_due, self._troubles = now + EVERY_S, self._channel.troubles

    def look(self, now: float) -> None:
        """Compare where that is due; the protocol tells of what is too many."""
        if now < self.next_due:
            return
        troubles, self._troubles = self._troubles, self._channel.troubles
        if troubles != self._troubles:  # answers that were late may come yet
            self.next_due = now + 2.0 * EVERY_S
            return
        self._channel.settle()
        self._channel.agree(self._channel.wiring.protocol.confirm)
        self.next_due = self._channel.wiring.clock.now() + EVERY_S
