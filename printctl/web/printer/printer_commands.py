"""Reach the printer's station, and command it."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from firmware_profiles import Printer, load
from printctl.machine.station import Station, StationStatus
from printctl.machine.station.status import NO_PRINTER
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError
from printctl.web.printer.following import Follower
from printctl.web.printer.status import PrinterStatus, described, rim_mm

# Give Printer page services the open station, provided the user holds the control lock.


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

    def heard(self, status: StationStatus) -> PrinterStatus:
        """Pass on a status that was the answer to a request."""
        self.follower.hear(status)
        return described(status)


CLEAR_MM: Final = 5.0
"""So far above the dish's rim is out of the bath."""
BLIND_LIFT_MM: Final = 20.0
"""How far up where nobody knows where the rim is; a controlled stop lifts as far."""


class PrinterCommands:
    """Each does one thing and gives the status after it; what the station refuses is raised.

    Parameters
    ----------
    access : PrinterAccess
    """

    def __init__(self, access: PrinterAccess) -> None:
        self._access = access

    def jog(
        self, who: Principal, axis: str, mm: float, speed_mm_s: float | None = None
    ) -> PrinterStatus:
        """Move the tip by ``mm`` along ``x``, ``y`` or ``z``."""
        with self._access.moving(who) as station:
            return self._access.heard(station.jog(axis, mm, speed_mm_s))

    def lift_out(self, who: Principal) -> PrinterStatus:
        """Move the tip straight up, out of the bath and above the dish's rim.

        Raises
        ------
        ConflictError
            When it is there already, or the axis ends below.
        """
        with self._access.moving(who) as station:
            return self._access.heard(station.jog("z", self._way_out(station.status)))

    def home(
        self, who: Principal, axes: Sequence[str], *, needle_off: bool = False
    ) -> PrinterStatus:
        """Home axes; with a dish below only when the needle was taken off."""
        with self._access.moving(who) as station:
            return self._access.heard(station.home(axes, needle_off=needle_off))

    def set_position(
        self,
        who: Principal,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
    ) -> PrinterStatus:
        """Say where the tip stands, mm; nothing moves, and the position is trusted from then on."""
        with self._access.moving(who) as station:
            return self._access.heard(station.set_position(x, y, z))

    def heat(self, who: Principal, name: str, celsius: float) -> PrinterStatus:
        """Set a heater's target; 0 is off."""
        return self._access.heard(self._access.ask(who).heat(name, celsius))

    def heaters_off(self, who: Principal) -> PrinterStatus:
        """Set every target to 0."""
        station = self._access.ask(who)
        status = station.status
        for one in status.temperatures:
            if one.target_c is not None:
                status = station.heat(one.name, 0.0)
        return self._access.heard(status)

    def plunger(self, who: Principal, ul: float, ul_s: float | None = None) -> PrinterStatus:
        """Push (above 0) or draw back so many µL."""
        with self._access.moving(who) as station:
            return self._access.heard(station.plunger(ul, ul_s))

    def mount(self, who: Principal, **parts: Any) -> PrinterStatus:
        """Say what is mounted."""
        return self._access.heard(self._access.ask(who).mount(**parts))

    def _way_out(self, status: StationStatus) -> float:
        if status.position_mm is None:
            raise ConflictError("the printer hasn't told where it stands; home it, or jog Z up")
        z = status.position_mm[2]
        rim = rim_mm(status.mounted)
        top = load(Printer, status.profile).z_mm.high if status.position_trusted else math.inf
        way = min(BLIND_LIFT_MM if rim is None else rim + CLEAR_MM - z, top - z)
        if way <= 0:
            raise ConflictError(
                f"the tip is at Z {z:.2f} mm already"
                + (", the end of the axis" if rim is None else f", the rim at {rim:.2f} mm")
            )
        return way
