"""Data class of a station's port settings; open the port, or start a simulated printer for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from firmware_profiles import Printer
from printctl.errors import PrinterFailedError
from printctl.machine.control.station_status import Place
from printctl.machine.errors import PortError
from printctl.machine.ports.transport import Transport, locate, open_port
from printctl.machine.process.simulated import SIMULATED, simulated_printer


@dataclass(frozen=True)
class Socket:
    """Where a printer is plugged in.

    Attributes
    ----------
    profile : str
        By name or path.
    printer : Printer
    port : str
        Device, address, ``auto`` or ``simulated``.
    baud : int, "auto" or None
    folder : Path
        For a simulated printer's log.
    sim_speed : float
        Times real time of a simulated printer; 0 for as fast as it can.
    """

    profile: str
    printer: Printer
    port: str
    baud: int | str | None
    folder: Path
    sim_speed: float

    @property
    def simulated(self) -> bool:
        """Whether the printer is a process of ours."""
        return self.port == SIMULATED

    @property
    def pace(self) -> float:
        """Times real time that the printer lives at."""
        return self.sim_speed if self.simulated else 1.0

    def plug_in(
        self,
        at: Place,
        job: Path | None = None,
        record: Path | None = None,
        journal: Path | None = None,
    ) -> Transport:
        """Open the port; of a simulated printer start one whose tip stands at ``at``.

        Raises
        ------
        PortError, HandshakeError
        """
        if not self.simulated:
            place = locate(self.port, self.baud, self.printer)
            return open_port(place.port, self.printer, place.baud)
        try:
            port = simulated_printer(
                self.profile,
                at,
                job,
                record,
                self.folder,
                speed=self.sim_speed,
                journal=journal,
            )
        except PrinterFailedError as exc:
            raise PortError(str(exc)) from exc
        return open_port(port, self.printer)
