"""Hold the station's open printer port; keep a simulated printer's last tip position."""

from __future__ import annotations

from pathlib import Path

from printctl.machine.control.station_status import Place
from printctl.machine.errors import PortLost
from printctl.machine.ports.transport import Transport
from printctl.machine.process.open_connection import Socket


class StationPort:
    """Opened and closed by the thread that owns it.

    Parameters
    ----------
    socket : Socket
    start : (x, y, z), mm
        Where a simulated printer's tip stands.

    Attributes
    ----------
    start : (x, y, z), mm
        Where it stands when it is started again.
    transport : Transport or None
        None while the port is closed.
    """

    def __init__(self, socket: Socket, start: Place) -> None:
        self.socket, self.start = socket, start
        self.transport: Transport | None = None

    def open(self) -> None:
        """Open the port; start a simulated printer.

        Raises
        ------
        PortError, HandshakeError
        """
        self.transport = self.socket.plug_in(self.start)

    def open_for(self, job: Path, record: Path, journal: Path, at: Place) -> None:
        """Start a fresh simulated printer, which records one print alone."""
        self.close()
        record.unlink(missing_ok=True)
        self.transport = self.socket.plug_in(at, job, record, journal)

    def opened(self) -> Transport:
        """Return the open port.

        Raises
        ------
        PortLost
            When it isn't open.
        """
        if self.transport is None:
            raise PortLost(f"{self.socket.port} isn't open")
        return self.transport

    def close(self) -> None:
        """Let go of the port."""
        if self.transport is not None:
            self.transport.close()
            self.transport = None

    def stands_at(self, place: Place) -> None:
        """Take notice of where the tip stands."""
        self.start = place
