"""`Transport` interface, TCP, opening a port by name, and finding port and baud rate.

A port is named ``/dev/ttyUSB0`` or ``COM3`` (serial, pseudo-terminals too), or
``tcp:HOST:PORT`` or ``socket://HOST:PORT``.

The one port that matches a profile is then asked: by the print's own handshake, or here where the
baud rate is to be found as well. What is asked here is the link's own question: a line with a
number far too high. Some families refuse it, others give their temperatures; nothing moves. At a
wrong baud rate it arrives as other bytes, none of which reads as a command
(`tests/printctl/machine/link/test_transport.py` samples its waveform at every other rate). The port
is opened once, so that a board resets once at most; the rate is changed while it is open.
"""

from __future__ import annotations

import re
import select
import socket
import threading
import time
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

from firmware_profiles import Printer
from firmware_profiles.families.timing import QUESTION
from printctl.machine.errors import HandshakeError, PortError, PortLost, PortMissing
from printctl.machine.ports.clock import Clock, RealClock
from printctl.machine.ports.detection import (
    AUTO,
    PortPrograms,
    named_port,
    rates_to_try,
    runs_files,
)
from printctl.machine.ports.locking import hold_address
from printctl.machine.ports.serial_port import CHUNK_BYTES, WRITE_LIMIT_S, SerialTransport

CONNECT_LIMIT_S: Final = 5.0
URGENT_LIMIT_S: Final = 0.5
"""Longest wait of an urgent write for room; whoever halts a printer repeats it."""
ANSWER_S: Final = 0.6
ROUNDS: Final = 2
FIRST_WORD_S: Final = 2.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
_TCP: Final = re.compile(r"(?:tcp:|socket://)(?P<host>\[.+\]|[^:]+):(?P<port>\d+)$")
_ANSWER: Final = re.compile(
    rb"(?m)^(?:Error:.*Last Line: \d+|Resend: ?\d+|ok(?: [ -~]*)?|echo:busy: [ -~]+)\r?$"
)


class Transport(Protocol):
    """Connection to a printer that carries bytes; users know it by ``name``.

    One thread reads and writes; `write_halt` and `reset` may be called by another at any moment,
    and neither waits for the first. Behind `write_halt` no byte leaves but those of another one,
    until the port is opened anew. After ``quiet_s`` of silence no reply is under way: longer than
    the wire's latency.
    """

    name: str
    quiet_s: float

    @property
    def stolen(self) -> int:
        """Count of another program's reads of what had come; 0 where that can't be noticed."""
        ...

    def programs(self) -> PortPrograms:
        """Find the other programs that have the port open; some 10 ms."""
        ...

    def write(self, data: bytes) -> bool:
        """Write all of ``data``, or raise `PortLost` within the transport's time limit.

        Return False where `write_halt` came first: what hadn't left is dropped.
        """
        ...

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        ...

    def write_urgent(self, data: bytes) -> bool:
        """Drop what hasn't left yet and write ``data`` at once; False as for `write`."""
        ...

    def write_halt(self, data: bytes) -> None:
        """Drop what hasn't left yet, write ``data`` at once, take nothing else; any thread."""
        ...

    def reset(self) -> bool:
        """Pulse the reset line; False where there is none."""
        ...

    def close(self) -> None:
        """Let go of the wire; closing twice does no harm."""
        ...


class TcpTransport:
    """Connection by TCP: a network bridge, or the simulated printer without a pty.

    There is no reset line, and nothing that a firmware could tell a new connection by. As with a
    serial port one process of this machine alone may be connected: raises `PortInUse`, or
    `PortMissing` where nothing listens.
    """

    quiet_s: float = 0.25
    stolen: int = 0

    def __init__(self, host: str, port: int, name: str) -> None:
        self.name = name
        self._held = hold_address(host, port, self.name)
        try:
            self._socket = socket.create_connection((host, port), CONNECT_LIMIT_S)
        except OSError as exc:
            self._held.close()
            raise PortMissing(
                f"nobody answers at {self.name} ({exc}); check host and port, and that the "
                "printer is on"
            ) from exc
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        self._out, self._halting = threading.Lock(), False

    def programs(self) -> PortPrograms:
        """Return none: no program reads another's connection."""
        return PortPrograms()

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        try:
            ready, _, _ = select.select([self._socket], [], [], max(0.0, timeout))
            data = self._socket.recv(CHUNK_BYTES) if ready else None
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as exc:
            raise self._lost(exc) from exc
        if data == b"":
            raise PortLost(f"connection {self.name} was closed by the printer")
        return data or b""

    def write(self, data: bytes) -> bool:
        """Write all of ``data``, or raise `PortLost` within `WRITE_LIMIT_S`; see `Transport`."""
        limit = time.monotonic() + WRITE_LIMIT_S
        while data:
            with self._out:
                if self._halting:
                    return False
                data = self._send(data)
            if data:
                self._await_room(limit, WRITE_LIMIT_S)
        return True

    def write_urgent(self, data: bytes) -> bool:
        """Write all of ``data``: of what was written before TCP has taken all."""
        return self.write(data)

    def write_halt(self, data: bytes) -> None:
        """Write all of ``data`` before anything else, from any thread; see `Transport`.

        What TCP has already taken goes before it. Raises `PortLost` where the connection stays full
        for `URGENT_LIMIT_S`.
        """
        limit = time.monotonic() + URGENT_LIMIT_S
        with self._out:  # held by `write` for a moment only
            self._halting = True
            while data := self._send(data):
                self._await_room(limit, URGENT_LIMIT_S)

    def _send(self, data: bytes) -> bytes:
        """Send what the connection takes now; return the rest."""
        try:
            return data[self._socket.send(data) :]
        except BlockingIOError:
            return data
        except (OSError, ValueError) as exc:
            raise self._lost(exc) from exc

    def _await_room(self, limit: float, limit_s: float) -> None:
        left = max(0.0, limit - time.monotonic())
        try:
            room = select.select([], [self._socket], [], left)[1]
        except (OSError, ValueError) as exc:
            raise self._lost(exc) from exc
        if not room:
            raise PortLost(f"connection {self.name} took no byte for {limit_s:g} s")

    def _lost(self, exc: Exception) -> PortLost:
        return PortLost(f"connection {self.name} went away: {exc}")

    def reset(self) -> bool:
        """Do nothing: there is no reset line."""
        return False

    def close(self) -> None:
        """Let go of the connection; closing twice does no harm."""
        self._socket.close()
        self._held.close()


def open_port(name: str, printer: Printer, baud: int | None = None) -> Transport:
    """Open the port called ``name`` for a printer, at ``baud`` in place of its profile's rate.

    Raises `PortError`: missing, denied or in use; the message says which and the remedy.
    """
    tcp = _TCP.match(name)
    if tcp:
        return TcpTransport(tcp["host"].strip("[]"), int(tcp["port"]), name)
    if runs_files(name):
        kind = name.partition("://")[0]
        raise PortError(f"{kind}:// is a network host that runs files; no line can be sent to it")
    if "://" in name or name.startswith("tcp:"):
        shown = name.rpartition("@")[2]  # what stands before it may be a password
        raise PortError(f"port {shown!r} isn't tcp:HOST:PORT, socket://HOST:PORT or a device")
    return SerialTransport(name, baud or printer.baud, printer.dtr, printer.rts)


class PrinterPort(NamedTuple):
    """Port and baud rate at which a printer answers."""

    port: str
    baud: int


def locate(port: str, baud: int | str | None, printer: Printer) -> PrinterPort:
    """Find port and baud rate where one or both are `AUTO`; opens the port for `AUTO` rates only.

    A ``baud`` of None is the profile's. Raises `PortError` where no port, or more than one, can be
    the printer's, or it can't be opened; `HandshakeError` where nothing answers at any rate tried.
    (A rate that is given isn't tried here: the print's own handshake does it.)
    """
    name = named_port(port, printer)
    if baud != AUTO:
        return PrinterPort(name, int(baud or printer.baud))
    rates = rates_to_try(printer)
    wire = open_port(name, printer, rates[0])
    try:
        if isinstance(wire, SerialTransport):
            return PrinterPort(name, sweep(wire, rates, RealClock(), printer.resets_on_connect))
        return PrinterPort(name, rates[0])  # TCP: whoever bridges it has chosen the rate
    except HandshakeError as exc:
        raise HandshakeError(f"{name}: {exc}") from exc
    finally:
        wire.close()


def sweep(wire: SerialTransport, rates: Sequence[int], clock: Clock, resets: bool) -> int:
    """Ask at one rate after the other; return the first at which a firmware answers.

    ``wire`` is open at the first rate. A board that ``resets`` when its port opens is given time to
    start. Raises `HandshakeError` where nothing answers, `PortLost` where the port goes away.
    """
    wait, limit = FIRST_WORD_S, clock.now() + BOOT_LIMIT_S
    # Wait for the first sign of a start, and until it is over; at whatever rate, it is a sign.
    while resets and clock.now() < limit and wire.read(wait):
        wait = BOOT_QUIET_S
    heard_bytes = 0
    for rate in [*rates] * ROUNDS:
        wire.set_baud(rate)
        wire.write(QUESTION)
        reply, limit = b"", clock.now() + ANSWER_S
        while (left := limit - clock.now()) > 0:
            reply += wire.read(left)
            if _ANSWER.search(reply[: reply.rfind(b"\n") + 1]):
                return rate
        heard_bytes += len(reply)
    raise HandshakeError(
        f"no firmware answers at {', '.join(map(str, rates))} Bd ({heard_bytes} bytes heard); "
        "check that the printer is on and no other program speaks to it, or give --baud"
    )
