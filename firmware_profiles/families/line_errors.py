"""Count resent lines on a serial link; report too many of them within a window of lines."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles.families.link_protocol import Noisy


@dataclass
class LineErrors:
    """Count of resent lines and their rate.

    Attributes
    ----------
    window, limit : int
        More than ``limit`` among ``window`` lines is too many.
    total : int
        Since the start.
    """

    window: int
    limit: int
    total: int = 0
    _start: int = 0
    _here: int = 0

    def count(self, number: int) -> Noisy | None:
        """Take notice that line ``number`` + 1 is sent again; `Noisy` when the limit is passed."""
        self.total += 1
        if number - self._start > self.window or number < self._start:
            self._start, self._here = number, 0
        self._here += 1
        if self._here <= self.limit:
            return None
        noisy = Noisy(self._here, number - self._start)
        self._start, self._here = number, 0
        return noisy
