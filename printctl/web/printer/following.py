"""Follow a printer's state, and keep what is plotted."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from printctl.machine.control.idle.station_status import StationState, StationStatus
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.client import Station, attach_station

APART_S: Final = 0.25
LOOK_AGAIN_S: Final = 2.0


class Follower:
    """Two threads: one follows the station, one passes on its last known status.

    A station that is alive in ``folder`` is found again, whoever started it. ``tell`` is given each
    new status, at most every `APART_S`.
    """

    def __init__(self, folder: Path, tell: Callable[[StationStatus], None]) -> None:
        self._folder, self._tell = folder, tell
        self.station: Station | None = None
        self.status = StationStatus(StationState.CLOSED, "no printer is connected")
        self._changed = threading.Condition()
        self._news = True
        self._ended = threading.Event()
        works = (self._hear_all, self._tell_all)
        self._threads = [threading.Thread(target=work, daemon=True) for work in works]
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """End both threads; the station goes on."""
        self._ended.set()
        station = self.station
        if station is not None:
            station.detach()
        with self._changed:
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(5.0)

    def follow(self, station: Station) -> None:
        """Follow this one from now on."""
        with self._changed:
            self.station = station
            self._changed.notify_all()

    def hear(self, status: StationStatus) -> None:
        """Take a status, also one that somebody was given as an answer."""
        with self._changed:
            self.status, self._news = status, True
            self._changed.notify_all()

    def _hear_all(self) -> None:
        while not self._ended.is_set():
            station = self.station or self._find()
            if station is not None:
                self._hear_one(station)
            with self._changed:  # one that was killed is found again at once, with its last word
                self._changed.wait_for(
                    lambda: self._ended.is_set() or self.station is not None, LOOK_AGAIN_S
                )

    def _find(self) -> Station | None:
        try:
            station = attach_station(self._folder)
            if station.status.state is StationState.CLOSED:
                return None
        except (LinkError, OSError):
            return None
        with self._changed:
            self.station = self.station or station
        return self.station

    def _hear_one(self, station: Station) -> None:
        with contextlib.suppress(LinkError, OSError):
            for status in station.events():
                if self.station is not station or self._ended.is_set():
                    return
                self.hear(status)
        if self._ended.is_set():
            return
        with contextlib.suppress(LinkError, OSError):
            self.hear(station.status)
        with self._changed:
            if self.station is station:
                self.station = None

    def _tell_all(self) -> None:
        while not self._ended.is_set():
            with self._changed:
                self._changed.wait_for(lambda: self._news or self._ended.is_set())
                self._news = False
                status = self.status
            if not self._ended.is_set():
                self._tell(status)
            self._ended.wait(APART_S)


KEPT_S: Final = 600.0
SAMPLES_APART_S: Final = 1.0
_READING: Final = re.compile(
    r"(?P<name>.+?): (?P<value>[-+.\deE]+) (?P<unit>\S+), at most (?P<high>[-+.\deE]+) \S+"
)
_Sample = dict[str, dict[str, float]]


class Plots:
    """Last ten minutes of temperatures and gauge readings; any thread may add or read."""

    def __init__(self) -> None:
        self._ring: deque[tuple[float, _Sample]] = deque()
        self._lock = threading.Lock()

    def add(self, status: StationStatus) -> None:
        """Keep a status's temperatures and readings, at most once a second."""
        if not status.open or not (status.temperatures or status.readings):
            return
        now = time.time()
        with self._lock:
            if self._ring and now - self._ring[-1][0] < SAMPLES_APART_S:
                return
            self._ring.append((now, _sample(status)))
            while self._ring[0][0] < now - KEPT_S:
                self._ring.popleft()

    def columns(self) -> dict[str, Any]:
        """Return the samples as a JSON object of columns, None where a quantity is unknown.

        ``at_s``, s since 1970; ``now_c`` and ``target_c``, °C by heater, a target of 0 left out;
        ``readings`` and their ``limits`` by question and unit, as ``M871 (N)``.
        """
        with self._lock:
            kept = list(self._ring)
        samples = [one for _, one in kept]

        def column(field: str) -> dict[str, list[float | None]]:
            names = dict.fromkeys(name for one in samples for name in one[field])
            return {name: [one[field].get(name) for one in samples] for name in names}

        fields = ("now_c", "target_c", "readings", "limits")
        return {"at_s": [at_s for at_s, _ in kept], **{name: column(name) for name in fields}}


def _sample(status: StationStatus) -> _Sample:
    matches = [match for text in status.readings if (match := _READING.fullmatch(text))]
    named = {f"{match['name']} ({match['unit']})": match for match in matches}
    return {
        "now_c": {one.name: one.now_c for one in status.temperatures},
        "target_c": {one.name: one.target_c for one in status.temperatures if one.target_c},
        "readings": {name: float(match["value"]) for name, match in named.items()},
        "limits": {name: float(match["high"]) for name, match in named.items()},
    }
