"""Remaining time of a print: the simulated time, corrected by the time taken so far.

The printed part is cut into stretches of equal time in the dry run. Of each the ratio of real to
predicted time is kept, pauses left out; what remains is taken to go on like their mean. Were the
stretches' ratios independent, of standard deviation s over n stretches, the time of the m
stretches still to come would be known to c s sqrt(m + m²/n), c being a stretch's time: the spread
of those m, and that of the mean. Twice that is the error told (about 95 of 100).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

_STRETCHES: Final = 100
"""Of a whole print; a stretch lasts two seconds at least, in the dry run's time."""
_LEAST_S: Final = 2.0
_ENOUGH: Final = 3
"""Stretches before the dry run's own time is corrected."""


@dataclass(frozen=True)
class Estimate:
    """Estimated remaining time.

    Attributes
    ----------
    remaining_s : float, s
    error_s : float or None, s
        Twice the standard deviation; None while too little has been printed to tell.
    ratio : float
        Real time over the dry run's, so far.
    """

    remaining_s: float
    error_s: float | None
    ratio: float


@dataclass
class Remaining:
    """Estimates the remaining time of one print.

    Parameters
    ----------
    total_s : float, s
        The dry run's time.
    """

    total_s: float
    _ratios: list[float] = field(default_factory=list)
    _from: tuple[float, float] | None = None
    _first: tuple[float, float] | None = None
    _last: tuple[float, float] | None = None

    @property
    def stretch_s(self) -> float:
        """Least time of a stretch, in the dry run's time, s."""
        return max(self.total_s / _STRETCHES, _LEAST_S)

    def saw(self, predicted_s: float, active_s: float) -> None:
        """Note that the print has come so far after so much time without pauses.

        Parameters
        ----------
        predicted_s : float, s
            The dry run's time of what has been executed.
        active_s : float, s
            Real time since the print's start, pauses left out.
        """
        here = predicted_s, active_s
        if self._from is None or self._last is None:
            self._first = self._from = self._last = here
            return
        if predicted_s < self._last[0] or active_s < self._last[1]:
            return  # a line was taken back; the stretch ends later
        self._last = here
        length = predicted_s - self._from[0]
        if length >= self.stretch_s:
            self._ratios.append((active_s - self._from[1]) / length)
            self._from = here

    def estimate(self, predicted_s: float) -> Estimate:
        """Tell what is left when the dry run's time of what has been executed is this, s."""
        left = max(self.total_s - predicted_s, 0.0)
        count = len(self._ratios)
        if count < _ENOUGH or self._first is None or self._from is None:
            return Estimate(left, None, 1.0)
        printed = self._from[0] - self._first[0]
        ratio = (self._from[1] - self._first[1]) / printed
        mean = math.fsum(self._ratios) / count
        spread = math.sqrt(math.fsum((one - mean) ** 2 for one in self._ratios) / (count - 1))
        each = printed / count
        ahead = left / each
        error = 2.0 * each * spread * math.sqrt(ahead + ahead * ahead / count)
        return Estimate(left * ratio, error, ratio)
