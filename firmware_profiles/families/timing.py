"""Time limits of a printer link's protocol, and the number of transmission errors it tolerates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_profiles.families.link_protocol import Noisy

HOST_LATE_S: Final = 1.0
"""A deadline missed by more: the host slept, which is no silence of the printer."""


@dataclass(frozen=True)
class Timing:
    """Time limits and the limit on line errors.

    Attributes
    ----------
    silence_s : float
        Without any sign of life while a line is in flight, until the printer is asked. It decides
        nothing but how soon a lost ok is noticed.
    deaf_s : float
        Of a firmware that says nothing while it is busy: after so long, and then as often, a notice
        is given and it is asked.
    quiet_s : float
        Of silence that counts as "no reply is under way"; longer than a USB adapter's latency.
    whole_s : float
        For the second half of a line from the printer, before it is asked for a token.
    answer_s : float
        For the answer to a question, until it is asked again.
    doubt_limit_s : float
        Without a usable answer until a printer that isn't found yet counts as silent, and until
        an alarm is given of one in mid-print. An answer that is later than this was lost.
    silent_limit_s : float
        Without a usable answer until a printer in mid-print counts as silent.
    busy_limit_s : float
        For one line of a firmware that says nothing while it is busy.
    noise_window, noise_limit : int
        More than ``noise_limit`` lines sent again among ``noise_window``: the print pauses.
    calm_lines : int
        After a doubt so many lines leave one by one, where two may be in flight.
    """

    silence_s: float = 1.8
    deaf_s: float = 60.0
    quiet_s: float = 0.05
    whole_s: float = 0.2
    answer_s: float = 0.8
    doubt_limit_s: float = 6.0
    silent_limit_s: float = 60.0
    busy_limit_s: float = 1800.0
    noise_window: int = 500
    noise_limit: int = 30
    calm_lines: int = 200


MAX_REFUSALS: Final = 100
"""Times in turn that one line is sent again. Noise that garbles nine of ten lines does that to one
in 40,000, and the print has paused long before; Marlin takes half a second for each."""


@dataclass
class LineErrors:
    """Count of resent lines and their rate.

    Attributes
    ----------
    window, limit : int
        More than ``limit`` among ``window`` lines is too many.
    total : int
        Since the start.
    in_turn : int
        Of the line that was sent again last, with no other in between.
    """

    window: int
    limit: int
    total: int = 0
    in_turn: int = 0
    _newest: int = -1
    _start: int = 0
    _here: int = 0

    def count(self, number: int) -> Noisy | None:
        """Take notice that line ``number`` + 1 is sent again; `Noisy` when the limit is passed."""
        self.total += 1
        self.in_turn = self.in_turn + 1 if number == self._newest else 1
        self._newest = number
        if number - self._start > self.window or number < self._start:
            self._start, self._here = number, 0
        self._here += 1
        if self._here <= self.limit:
            return None
        noisy = Noisy(self._here, number - self._start)
        self._start, self._here = number, 0
        return noisy

    @property
    def stuck(self) -> bool:
        """Whether one line was sent again so often that it never will be taken."""
        return self.in_turn >= MAX_REFUSALS


QUESTION: Final = b"\nN99999999 M105*23\n"
"""A line with a number far too high: families that count lines refuse it, others tell their
temperatures. It starts with a line end, to end what noise may have left open. Any tail of it that
survives a flush reads M105 or an unknown command, both harmless."""
