"""`Transport` interface, and its factory by port name.

A port is named ``/dev/ttyUSB0`` or ``COM3`` (serial, pseudo-terminals too), or
``tcp:HOST:PORT`` or ``socket://HOST:PORT``.
"""

from __future__ import annotations

import re
from typing import Protocol

from firmware_profiles import Printer
from printctl.machine.errors import PortError
from printctl.machine.ports.port_list import PortPrograms
from printctl.machine.ports.serial_port import SerialTransport
from printctl.machine.ports.tcp_port import TcpTransport

_TCP = re.compile(r"(?:tcp:|socket://)(?P<host>\[.+\]|[^:]+):(?P<port>\d+)$")


class Transport(Protocol):
    """Connection to a printer that carries bytes.

    One thread reads and writes; `write_urgent` and `reset` may be called by another at any
    moment, and neither waits for the first.

    Attributes
    ----------
    name : str
        As the user knows it.
    quiet_s : float
        Of silence after which no reply is under way; longer than the wire's latency.
    stolen : int
        Times that another program read what had come; 0 where that can't be noticed.
    """

    name: str
    quiet_s: float

    @property
    def stolen(self) -> int:
        """See the class."""
        ...

    def programs(self) -> PortPrograms:
        """Find the other programs that have the port open; some 10 ms."""
        ...

    def write(self, data: bytes) -> None:
        """Write all of ``data``, or raise `PortLost` within the transport's time limit."""
        ...

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        ...

    def write_urgent(self, data: bytes) -> None:
        """Drop what hasn't left yet and write ``data`` at once, from any thread."""
        ...

    def reset(self) -> bool:
        """Pulse the reset line; False where there is none."""
        ...

    def close(self) -> None:
        """Let go of the wire; closing twice does no harm."""
        ...


def open_port(name: str, printer: Printer, baud: int | None = None) -> Transport:
    """Open the port called ``name`` for a printer.

    Parameters
    ----------
    name : str
        See the module.
    printer : Printer
        Profile: baud rate, and what opening does to the board.
    baud : int, optional
        In place of the profile's.

    Raises
    ------
    PortError
        Missing, denied or in use; the message says which and the remedy.
    """
    tcp = _TCP.match(name)
    if tcp:
        return TcpTransport(tcp["host"].strip("[]"), int(tcp["port"]), name)
    if "://" in name or name.startswith("tcp:"):
        raise PortError(f"port {name!r} isn't tcp:HOST:PORT, socket://HOST:PORT or a device")
    return SerialTransport(name, baud or printer.baud, printer.dtr, printer.rts)
