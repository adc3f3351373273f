"""Service behind the Printer page: connection, status, manual control, console, calibration."""

from __future__ import annotations

from firmware_profiles import Printer
from printctl.machine.link.port_detection import AUTO
from printctl.machine.station import StationStatus, connect
from printctl.web.controls import Principal
from printctl.web.core import Core
from printctl.web.errors import ConflictError
from printctl.web.printer.calibration import Calibrating
from printctl.web.printer.choices import (
    FoundPort,
    PartChoice,
    PrinterChoice,
    part_choices,
    ports_with_profiles,
    printer_choices,
)
from printctl.web.printer.console import Console, Macros
from printctl.web.printer.following import Follower, Plots
from printctl.web.printer.part_change import Changing, Guide
from printctl.web.printer.printer_commands import PrinterAccess, PrinterCommands
from printctl.web.printer.status import PrinterStatus, described
from printctl.web.profile_store import ProfileStore


class PrinterService:
    """The printer's room; any thread may call, and calls may block.

    It follows a station in the workspace from the moment it is made, whoever started that one.

    Parameters
    ----------
    core : Core

    Attributes
    ----------
    commands : PrinterCommands
        Moves, heaters, plunger, what is mounted.
    console : Console
    macros : Macros
    guide : Guide
        Touching off floor and bath.
    changing : Changing
        Another syringe or needle.
    calibrating : Calibrating
    store : ProfileStore
        Profiles to choose from.
    plots : Plots
    """

    def __init__(self, core: Core) -> None:
        self.core = core
        self.plots = Plots()
        self.store = ProfileStore(core.workspace.root)
        self._follower = Follower(core.workspace.station, self._publish)
        self._access = PrinterAccess(core, self._follower)
        self.commands = PrinterCommands(self._access)
        self.console = Console(self._access)
        self.macros = Macros(self._access, self.store, self.console)
        self.guide = Guide(self._access)
        self.changing = Changing(self._access, self.store)
        self.calibrating = Calibrating(self._access, self.store)
        self._follower.begin()

    def close(self) -> None:
        """Follow no more; the station goes on."""
        self._follower.end()

    @property
    def status(self) -> PrinterStatus:
        """The station as it was heard of last; closed where there is none."""
        return described(self._access.status)

    def ports(self) -> list[FoundPort]:
        """Serial ports of this machine, and whose profile's USB id each has."""
        return ports_with_profiles(self.store)

    def printers(self) -> list[PrinterChoice]:
        """Printer profiles that can be connected."""
        return printer_choices(self.store)

    def parts(self) -> dict[str, list[PartChoice]]:
        """Needles, syringes, inks, dishes and baths that can be mounted."""
        return part_choices(self.store)

    def connect(
        self, who: Principal, profile: str, port: str = AUTO, baud: int | str | None = None
    ) -> PrinterStatus:
        """Connect a printer, and check that it is the profile's.

        Parameters
        ----------
        who : Principal
        profile : str
            Name on the store.
        port : str
            A device, a TCP address, ``auto`` or ``simulated``.
        baud : int, ``auto`` or None
            None for the profile's.

        Raises
        ------
        ConflictError
            When one is connected already.
        NotInControlError, NotFoundError, LinkError
        """
        self.core.controls.require(who)
        if self._follower.station is not None and self.status.open:
            raise ConflictError(
                f"{self.status.profile} is connected at {self.status.port}; disconnect it first"
            )
        given = self.store.given(Printer, profile)
        # The simulated printer stands clear of its ends, so that every axis can be jogged.
        printer = self.store.load(Printer, profile)
        spans = (printer.x_mm, printer.y_mm, printer.z_mm)
        x, y, z = (span.low + min(30.0, (span.high - span.low) / 2) for span in spans)
        station = connect(
            given,
            port,
            self.core.workspace.station,
            baud=baud,
            sim_speed=self.core.settings.sim_speed,
            start_mm=(x, y, z),
        )
        self._follower.follow(station)
        return self._access.heard(station.status)

    def disconnect(self, who: Principal) -> PrinterStatus:
        """Let go of the port; the heaters go off. Refused while printing."""
        station = self._access.ask(who)
        station.close()
        return self._access.heard(station.status)

    def reconnect(self, who: Principal) -> PrinterStatus:
        """Open the port again and check the printer, after a halt or a lost port."""
        return self._access.heard(self._access.ask(who).reconnect())

    def stop_motion(self) -> PrinterStatus:
        """Stop a move by hand; needs no controls."""
        return self._access.heard(self._access.station().stop_motion())

    def _publish(self, status: StationStatus) -> None:
        self.plots.add(status)
        self.core.events.publish("station", **described(status).to_dict())
