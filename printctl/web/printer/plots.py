"""Ring buffer of the last ten minutes of temperatures and gauge readings, for all browsers."""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from printctl.machine.station import StationStatus

KEPT_S: Final = 600.0
APART_S: Final = 1.0
_READING: Final = re.compile(
    r"(?P<name>.+?): (?P<value>[-+.\deE]+) (?P<unit>\S+), at most (?P<high>[-+.\deE]+) \S+"
)


@dataclass(frozen=True)
class Sample:
    """What was read at one moment.

    Attributes
    ----------
    at_s : float, s since 1970
    now, target : dict of str to float, °C
        By heater; a target of one that is off is left out.
    readings : dict of str to float
        By question and unit, as ``M871 (N)``.
    limits : dict of str to float
        Of the readings.
    """

    at_s: float
    now: dict[str, float]
    target: dict[str, float]
    readings: dict[str, float]
    limits: dict[str, float]


def sample(status: StationStatus, at_s: float) -> Sample:
    """What a status tells for the plots."""
    matches = [match for text in status.readings if (match := _READING.fullmatch(text))]
    names = [f"{match['name']} ({match['unit']})" for match in matches]
    return Sample(
        at_s,
        {one.name: one.now_c for one in status.temperatures},
        {one.name: one.target_c for one in status.temperatures if one.target_c},
        dict(zip(names, (float(match["value"]) for match in matches), strict=True)),
        dict(zip(names, (float(match["high"]) for match in matches), strict=True)),
    )


class Plots:
    """A ring of samples; any thread may add or read.

    Parameters
    ----------
    clock : function
        Seconds since 1970.
    """

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._ring: deque[Sample] = deque()
        self._lock = threading.Lock()

    def add(self, status: StationStatus) -> None:
        """Keep what a status tells, at most once a second."""
        if not status.open or not (status.temperatures or status.readings):
            return
        now = self._clock()
        with self._lock:
            if self._ring and now - self._ring[-1].at_s < APART_S:
                return
            self._ring.append(sample(status, now))
            while self._ring[0].at_s < now - KEPT_S:
                self._ring.popleft()

    def samples(self) -> list[Sample]:
        """Oldest first."""
        with self._lock:
            return list(self._ring)

    def columns(self) -> dict[str, Any]:
        """As a JSON object of columns; None where a quantity wasn't told."""
        kept = self.samples()

        def column(field: str) -> dict[str, list[float | None]]:
            names = dict.fromkeys(name for one in kept for name in getattr(one, field))
            return {name: [getattr(one, field).get(name) for one in kept] for name in names}

        return {
            "at_s": [one.at_s for one in kept],
            "now_c": column("now"),
            "target_c": column("target"),
            "readings": column("readings"),
            "limits": column("limits"),
        }
