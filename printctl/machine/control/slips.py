"""Detect job lines that noise garbled despite a valid checksum, by checking positions."""

from __future__ import annotations

from typing import Final

from printctl.machine.control.channel import Channel
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.job.coordinates import axes_placed, mismatched_axes

SOONEST_LINES: Final = 5
"""So many lines after an error the position is compared: a word garbled past the checksum (X to Z)
stays wrong until a later line gives it again."""
CHECK_LINES: Final = 40
"""Twice as many after each comparison that agrees, up to this."""
NOISY_LINES: Final = 250
"""For so many lines after an error a line counts as one that makes errors."""
AGAIN_LINES: Final = 2
"""After so many more a position that was wrong is compared again."""


class SlipWatch:
    """Compares the position soon after an error, and often for a while.

    Parameters
    ----------
    channel : Channel
    position : PositionCheck
    """

    def __init__(self, channel: Channel, position: PositionCheck) -> None:
        self._channel, self._position = channel, position
        self._logbook, self._progress = channel.logbook, channel.logbook.progress
        self._protocol = channel.wiring.protocol
        self._checked = self._errors_seen = self._noisy_until = 0
        self._every = SOONEST_LINES
        self._slip = ""

    @property
    def noisy(self) -> bool:
        """Whether the wire made an error, or another program wrote, not long ago."""
        return self._progress.done < self._noisy_until

    @property
    def due(self) -> bool:
        """Whether to compare the position now."""
        errors, done = self._protocol.line_errors + self._progress.foreign, self._progress.done
        if errors != self._errors_seen:
            self._errors_seen, self._noisy_until = errors, done + NOISY_LINES
            self._every = AGAIN_LINES if self._slip else SOONEST_LINES
        return done < self._noisy_until and done - self._checked >= self._every

    def next_stop(self, stop: int) -> int:
        """Return after which line the position is to be compared, at most ``stop``."""
        if not self.noisy:
            return stop
        return min(stop, max(self._checked + self._every, self._progress.done + 1))

    def look(self) -> None:
        """Compare the position; where the next lines put it right, again after them.

        A word that was garbled past the checksum and given again since did its harm; the print
        goes on, with an alarm. One that would stay wrong (a Z within a layer) ends it at once.
        """
        self._channel.settle()
        done = self._checked = self._progress.done
        at, lines = self._progress.modal(), self._progress.job.lines
        wrong, position = ("", {}) if self._slip else self._position.compare(at)
        soon = set(axes_placed(lines[done : done + AGAIN_LINES]))
        if wrong and position and soon.issuperset(mismatched_axes(at, position)):
            self._position.refuse_renamed()
            self._slip = f"after line {done}: {wrong}"
            self._every, self._noisy_until = AGAIN_LINES, done + NOISY_LINES
            return
        self._position.verify(at)
        self._every = min(2 * self._every, CHECK_LINES)
        if self._slip:
            self._logbook.alarm(
                f"{self._slip}: a line slipped through its checksum; look at the part"
            )
            self._slip = ""
