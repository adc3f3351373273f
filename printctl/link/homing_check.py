"""Bed levelling that a firmware switches on with the job's own homing, switched off again.

Before the start levelling is off, or the print is refused. A Marlin that was built with
ENABLE_LEVELING_AFTER_G28 switches it on behind each G28 all the same, and from then on moves Z
along with X and Y.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

from printctl.gate.firmware import levelling_is_on, questions
from printctl.link.channel import Channel
from printctl.link.modal import HOMING
from sim.reading import code_of

_LIST: Final = "M503 S0"
_OFF: Final = b"M420 S0"
_TRIES: Final = 4


class HomingCheck:
    """Looks at the firmware's levelling behind each line of the job that homes.

    Parameters
    ----------
    channel : Channel
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._progress = channel, channel.logbook.progress
        self._looked = -1
        self._behind: tuple[int, ...] | None = None

    def next_stop(self, stop: int) -> int:
        """Return after which line to `look`, at most ``stop``."""
        behind, done = self._homings(), self._progress.done
        here = done in behind and done != self._looked
        place = bisect_right(behind, done)
        return done if here else min([stop, *behind[place : place + 1]])

    def look(self) -> str:
        """Switch levelling off where the job has homed just now; return what is wrong, or ''."""
        done = self._progress.done
        if done not in self._homings() or done == self._looked:
            return ""
        self._channel.settle()
        self._looked = done
        for _ in range(_TRIES):
            if not self._is_on():
                return ""
            self._channel.logbook.alarm(
                f"homing switched bed levelling on; switched off by {_OFF.decode()}"
            )
            self._channel.command(_OFF)
        return (
            f"after line {done}: homing switched bed levelling on, and {_OFF.decode()} changed "
            "nothing: Z would move along with X and Y. Switch it off with the maker's own program"
        )

    def _is_on(self) -> bool:
        said = self._channel.command(_LIST.encode())
        lines = [line.decode("ascii", "replace") for line in said]
        return levelling_is_on(lines, self._channel.wiring.printer)

    def _homings(self) -> tuple[int, ...]:
        """Counts of lines behind which to look, read once."""
        if self._behind is None:
            asks = _LIST in questions(self._channel.wiring.printer)
            lines = self._progress.job.lines if asks else ()
            self._behind = tuple(
                k for k, line in enumerate(lines, 1) if b"2" in line and code_of(line) in HOMING
            )
        return self._behind
