"""Detect another program's lines to the printer: send a token at intervals, count oks before it."""

from __future__ import annotations

import math
from typing import Final

from printctl.link.channel import Channel
from printctl.link.families import link_facts

EVERY_S: Final = 5.0
"""Interval of comparisons: each costs a line and its answer, while the planner goes on."""


class AnswerCount:
    """Notices lines that another program wrote to the printer.

    Such a line is answered by an ok that is taken for the next line's, and so on: from then on each
    ok is one line early. A token shows it: one ok more comes before its echo (``Stray``).

    Parameters
    ----------
    channel : Channel

    Attributes
    ----------
    next_due : float, s
        When they are compared next; infinite where the printer would have to stand still for it.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self.next_due = math.inf

    def begin(self, now: float) -> None:
        """Compare for the first time a while after ``now``."""
        if link_facts(self._channel.wiring.printer).confirms_at_once:
            self.next_due = now + EVERY_S

    def look(self, now: float) -> None:
        """Compare where that is due; the protocol tells of what is too many."""
        if now < self.next_due:
            return
        self._channel.settle()
        self._channel.agree(self._channel.wiring.protocol.confirm)
        self.next_due = self._channel.wiring.clock.now() + EVERY_S
