"""A printer's port, open or not; a simulated printer is started for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer, load
from printctl.errors import PrinterFailedError
from printctl.machine.control.idle.station_status import Place
from printctl.machine.errors import PortError, PortLost
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.ports.transport import Transport, locate, open_port
from printctl.machine.process.simulated import simulated_printer
from printctl.machine.records.record import SIM_ADDRESS

LINGER_S: Final = 900.0
"""A print's simulated printer waits so long for someone who goes on, if its link process dies."""


@dataclass
class Plug:
    """A printer's port; opened and closed by the thread that owns it.

    Attributes
    ----------
    profile : str
        By name or path.
    port : str
        Device, address, ``auto`` or ``simulated``.
    folder : Path
        For a simulated printer's log.
    baud : int, "auto" or None
        In place of the profile's.
    sim_speed : float
        Times real time of a simulated printer; 0 for as fast as it can.
    start_mm : (x, y, z), mm
        Where a simulated printer's tip stands when it is started (again).
    transport : Transport or None
        None while the port is closed.
    address : Path or None
        Of a simulated printer that outlives this process (`LINGER_S`).
    """

    profile: str
    port: str
    folder: Path
    baud: int | str | None = None
    sim_speed: float = 1.0
    start_mm: Place = (0.0, 0.0, 0.0)
    transport: Transport | None = None
    address: Path | None = None

    @staticmethod
    def from_json(data: dict[str, Any]) -> Plug:
        """Read a plug that another process has described."""
        x, y, z = data.get("start_mm", (0.0, 0.0, 0.0))
        return Plug(**{**data, "folder": Path(data["folder"]), "start_mm": (x, y, z)})

    @cached_property
    def printer(self) -> Printer:
        """The profile; ProfileError where it can't be read."""
        return load(Printer, self.profile)

    @property
    def simulated(self) -> bool:
        """Whether the printer is a process of ours."""
        return self.port == SIMULATED

    @property
    def pace(self) -> float:
        """Times real time that the printer lives at."""
        return self.sim_speed if self.simulated else 1.0

    def open(self) -> Transport:
        """Open the port, or start a simulated printer; PortError or HandshakeError else."""
        if self.simulated:
            return self._start(self.start_mm, self.folder)
        place = locate(self.port, self.baud, self.printer)
        self.transport = open_port(place.port, self.printer, place.baud)
        return self.transport

    def open_for(self, job: Path, record: Path, journal: Path, at: Place) -> Transport:
        """Start a fresh simulated printer, which records one print alone.

        It outlives this process for a while, so that its print can be gone on with.
        """
        self.close()
        record.unlink(missing_ok=True)
        self.address = journal.parent / SIM_ADDRESS
        return self._start(at, journal.parent, job, record, journal, linger_s=LINGER_S)

    def _start(
        self, at: Place, folder: Path, *print_files: Path | None, linger_s: float = 0.0
    ) -> Transport:
        job, record, journal = print_files or (None, None, None)
        try:
            port = simulated_printer(
                self.profile,
                at,
                job,
                record,
                folder,
                speed=self.sim_speed,
                journal=journal,
                linger_s=linger_s,
            )
        except PrinterFailedError as exc:
            raise PortError(str(exc)) from exc
        self.transport = open_port(port, self.printer)
        return self.transport

    def opened(self) -> Transport:
        """Return the open port; PortLost when it isn't open."""
        if self.transport is None:
            raise PortLost(f"{self.port} isn't open")
        return self.transport

    def close(self) -> None:
        """Let go of the port; a simulated printer that would wait for another host ends."""
        if self.address is not None:
            self.address.unlink(missing_ok=True)
            self.address = None
        if self.transport is not None:
            self.transport.close()
            self.transport = None
