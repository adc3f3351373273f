"""Give Printer page services the open station, provided the user holds the control lock."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from printctl.machine.station import Station, StationStatus
from printctl.machine.station.status import NO_PRINTER
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError
from printctl.web.printer.following import Follower


class PrinterAccess:
    """What all parts of the printer's room share.

    Parameters
    ----------
    core : Core
    follower : Follower
    """

    def __init__(self, core: Core, follower: Follower) -> None:
        self.core, self.follower = core, follower
        self._moving = threading.Lock()

    @property
    def status(self) -> StationStatus:
        """The station as it was heard of last."""
        return self.follower.status

    def station(self) -> Station:
        """The station that is open.

        Raises
        ------
        ConflictError
            When no printer is connected.
        """
        station = self.follower.station
        if station is None:
            raise ConflictError(NO_PRINTER)
        return station

    def ask(self, who: Principal) -> Station:
        """The station, for who holds the controls.

        Raises
        ------
        NotInControlError, ConflictError
        """
        self.core.controls.require(who)
        return self.station()

    @contextmanager
    def moving(self, who: Principal) -> Iterator[Station]:
        """The same for what moves: one move at a time, none waits for another to end.

        A move that waited would begin after the key was let go.

        Raises
        ------
        NotInControlError, ConflictError
        """
        station = self.ask(who)
        if not self._moving.acquire(blocking=False):
            raise ConflictError("the last move hasn't ended yet; wait for it")
        try:
            yield station
        finally:
            self._moving.release()

    def heard(self, status: StationStatus) -> StationStatus:
        """Pass on a status that was the answer to a request."""
        self.follower.hear(status)
        return status
