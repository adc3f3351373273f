"""Service behind the Printer page: connect, follow and command the workspace's station."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from firmware_profiles import Printer
from printctl.machine.control.idle.station_status import NO_PRINTER, StationStatus
from printctl.machine.ports.detection import AUTO
from printctl.machine.process.clients.client import Station
from printctl.machine.process.clients.starting import connect
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError
from printctl.web.printer.following import Follower, Plots
from printctl.web.printer.status import PrinterStatus, described
from printctl.web.profile_store import ProfileStore
from printctl.web.rest import Asking


class PrinterService:
    """The workspace's printer; any thread may call, and calls may block.

    It follows a station in the workspace from the moment it is made, whoever started that one.
    """

    def __init__(self, core: Core) -> None:
        self.core = core
        self.plots = Plots()
        self.store = ProfileStore(core.workspace.root)
        self._moving = threading.Lock()
        self._follower = Follower(core.workspace.station, self._publish)

    def close(self) -> None:
        """Follow no more; the station goes on."""
        self._follower.end()

    @property
    def status(self) -> PrinterStatus:
        """Last known status of the station; closed where there is none."""
        return described(self._follower.status)

    def station(self) -> Station:
        """Return the station that is open; ConflictError when no printer is connected."""
        station = self._follower.station
        if station is None:
            raise ConflictError(NO_PRINTER)
        return station

    def ask(self, who: Principal) -> Station:
        """Return the station, for who holds the controls; NotInControlError for others."""
        self.core.controls.require(who)
        return self.station()

    @contextmanager
    def moving(self, who: Principal) -> Iterator[Station]:
        """Give the station for what moves: one move at a time, none waits for another to end.

        A move that waited would begin after the key was let go.
        """
        station = self.ask(who)
        if not self._moving.acquire(blocking=False):
            raise ConflictError("the last move hasn't ended yet; wait for it")
        try:
            yield station
        finally:
            self._moving.release()

    def heard(self, status: StationStatus) -> PrinterStatus:
        """Pass on a status that was the answer to a request."""
        self._follower.hear(status)
        return described(status)

    def connect(
        self, who: Principal, profile: str, port: str = AUTO, baud: int | str | None = None
    ) -> PrinterStatus:
        """Connect a printer, and check that it is the profile's.

        The port is a device, a TCP address, ``auto`` or ``simulated``; None takes the profile's
        baud rate. ConflictError when one is connected already.
        """
        self.core.controls.require(who)
        now = self.status
        if self._follower.station is not None and now.open:
            raise ConflictError(f"{now.profile} is connected at {now.port}; disconnect it first")
        # The simulated printer stands clear of its ends, so that every axis can be jogged.
        printer = self.store.load(Printer, profile)
        spans = (printer.x_mm, printer.y_mm, printer.z_mm)
        x, y, z = (span.low + min(30.0, (span.high - span.low) / 2) for span in spans)
        station = connect(
            self.store.given(Printer, profile),
            port,
            self.core.workspace.station,
            baud=baud,
            sim_speed=self.core.settings.sim_speed,
            start_mm=(x, y, z),
        )
        self._follower.follow(station)
        return self.heard(station.status)

    def disconnect(self, who: Asking) -> PrinterStatus:
        """Let go of the port; the heaters go off. Refused while printing."""
        station = self.ask(who)
        station.close()
        return self.heard(station.status)

    def _publish(self, status: StationStatus) -> None:
        self.plots.add(status)
        self.core.events.publish("station", **described(status).to_dict())
