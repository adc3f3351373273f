"""Follow a printer's state, and keep what is plotted."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from printctl.machine.link.errors import LinkError
from printctl.machine.station import Station, StationState, StationStatus, attach

APART_S: Final = 0.25
LOOK_AGAIN_S: Final = 2.0
NOBODY: Final = StationStatus(StationState.CLOSED, "no printer is connected")


class Follower:
    """Two threads: one hears the station, one tells what was heard last.

    Parameters
    ----------
    folder : Path
        The station's. One that is alive there is found again, whoever started it.
    tell : function
        Given a status when there is a new one.
    """

    def __init__(self, folder: Path, tell: Callable[[StationStatus], None]) -> None:
        self._folder, self._tell = folder, tell
        self._station: Station | None = None
        self._status = NOBODY
        self._changed = threading.Condition()
        self._untold = True
        self._ended = threading.Event()
        self._threads: list[threading.Thread] = []

    @property
    def status(self) -> StationStatus:
        """What was heard last."""
        return self._status

    @property
    def station(self) -> Station | None:
        """The station followed; None when none is there."""
        return self._station

    def begin(self) -> None:
        """Start both threads."""
        for work in (self._hear_all, self._tell_all):
            thread = threading.Thread(target=work, name=f"printer {work.__name__}", daemon=True)
            thread.start()
            self._threads.append(thread)

    def end(self) -> None:
        """End them; the station goes on."""
        self._ended.set()
        station = self._station
        if station is not None:
            station.detach()
        with self._changed:
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(5.0)

    def follow(self, station: Station) -> None:
        """Follow this one from now on."""
        with self._changed:
            self._station = station
            self._changed.notify_all()
        with contextlib.suppress(LinkError, OSError):  # gone again already: heard by the thread
            self.hear(station.status)

    def hear(self, status: StationStatus) -> None:
        """Take a status that somebody was given as an answer."""
        with self._changed:
            self._status, self._untold = status, True
            self._changed.notify_all()

    def _hear_all(self) -> None:
        while not self._ended.is_set():
            station = self._station or self._found()
            if station is not None:
                self._hear_one(station)
            with self._changed:  # one that was killed is found again at once, with its last word
                self._changed.wait_for(self._is_there, LOOK_AGAIN_S)

    def _is_there(self) -> bool:
        return self._ended.is_set() or self._station is not None

    def _found(self) -> Station | None:
        try:
            station = attach(self._folder)
            status = station.status
        except (LinkError, OSError):
            return None
        if status.state is StationState.CLOSED:
            return None
        with self._changed:
            self._station = self._station or station
        return self._station

    def _hear_one(self, station: Station) -> None:
        with contextlib.suppress(LinkError, OSError):
            for status in station.events():
                if self._station is not station or self._ended.is_set():
                    return
                self.hear(status)
        if self._ended.is_set():
            return
        with contextlib.suppress(LinkError, OSError):
            self.hear(station.status)
        with self._changed:
            if self._station is station:
                self._station = None

    def _tell_all(self) -> None:
        while not self._ended.is_set():
            with self._changed:
                self._changed.wait_for(lambda: self._untold or self._ended.is_set())
                self._untold = False
                status = self._status
            if not self._ended.is_set():
                self._tell(status)
            self._ended.wait(APART_S)


# Ring buffer of the last ten minutes of temperatures and gauge readings, for all browsers.

KEPT_S: Final = 600.0
SAMPLES_APART_S: Final = 1.0
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
            if self._ring and now - self._ring[-1].at_s < SAMPLES_APART_S:
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
