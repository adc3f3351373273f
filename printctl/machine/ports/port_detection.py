"""Detect a printer's port by its USB id, and its baud rate by trying several.

A port is chosen by USB id and by nothing else: other machines may be on other ports, and opening
one may reset a board. Where not exactly one port matches the profile the choice is refused, and
the candidates are listed. The one that matches is
then asked: by the print's own handshake, or here where the baud rate is to be found as well.

What is asked here is the link's own question: a line with a number far too high. Some families
refuse it, others tell their temperatures; nothing moves. At a wrong baud rate it arrives as other
bytes, none of which reads as a command (`tests/printctl/machine/link/test_transport.py`
samples its waveform at every other rate). The port is opened once, so that a board resets once at
most; the rate is changed while it is open.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from firmware_profiles import Printer
from firmware_profiles.families.link_protocol import QUESTION
from printctl.machine.errors import HandshakeError, PortError, PortMissing
from printctl.machine.ports.clock import Clock, RealClock
from printctl.machine.ports.port_list import PortInfo, list_ports
from printctl.machine.ports.serial_port import SerialTransport
from printctl.machine.ports.transport import open_port

AUTO: Final = "auto"
"""In place of a port's name or a baud rate."""

ANSWER_S: Final = 0.6
ROUNDS: Final = 2
FIRST_WORD_S: Final = 2.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
_ANSWER: Final = re.compile(
    rb"(?m)^(?:Error:.*Last Line: \d+|Resend: ?\d+|ok(?: [ -~]*)?|echo:busy: [ -~]+)\r?$"
)


class TunableBaud(Protocol):
    """A wire whose baud rate can be changed while it is open."""

    def write(self, data: bytes) -> None:
        """Write all of ``data``."""
        ...

    def read(self, timeout: float) -> bytes:
        """Give what has come within ``timeout`` s."""
        ...

    def set_baud(self, baud: int) -> None:
        """Change the rate, and forget what came at another."""
        ...


@dataclass(frozen=True)
class PrinterPort:
    """Port and baud rate at which a printer answers.

    Attributes
    ----------
    port : str
    baud : int
    """

    port: str
    baud: int


def matches(printer: Printer, port: PortInfo) -> bool:
    """Whether a port's USB id, and serial number where the profile has one, are the profile's."""
    return any(
        wanted in (port.usb_id, f"{port.usb_id}:{port.serial_number}") and port.usb_id
        for wanted in printer.usb_ids
    )


def choose_port(printer: Printer, ports: Iterable[PortInfo] | None = None) -> str:
    """Name the one port that has the profile's USB id.

    Parameters
    ----------
    printer : Printer
    ports : iterable of PortInfo, optional
        This machine's by default.

    Raises
    ------
    PortMissing
        When none has it, or the profile names none.
    PortError
        When several have it.
    """
    every = list(list_ports() if ports is None else ports)
    listed = "; ".join(map(_described, every)) or "none"
    if not printer.usb_ids:
        raise PortMissing(
            f"the profile of {printer.name} names no USB id (usb_ids), so no port can be chosen; "
            f"ports found: {listed}; give --port, or write the id into the profile"
        )
    matching = [port for port in every if matches(printer, port)]
    if not matching:
        raise PortMissing(
            f"no port has a USB id of {printer.name} ({', '.join(printer.usb_ids)}); ports found: "
            f"{listed}; check cable and power, or give --port"
        )
    if len(matching) > 1:
        raise PortError(
            f"several ports have a USB id of {printer.name}: "
            f"{'; '.join(map(_described, matching))}; "
            "give --port, or usb_ids with the serial number (VVVV:PPPP:SERIAL) in the profile"
        )
    return matching[0].device


def read_baud(text: str | None) -> int | str | None:
    """Read a baud rate as a user gives it: a number, `AUTO`, or nothing for the profile's.

    Raises
    ------
    PortError
    """
    if text is None or text == AUTO:
        return text
    if not text.isdecimal() or not 300 <= int(text) <= 4_000_000:
        raise PortError(f"baud rate {text!r} is neither a number nor {AUTO}")
    return int(text)


def named_port(port: str, printer: Printer) -> str:
    """A port's name, chosen by `choose_port` where it is `AUTO`; nothing is opened."""
    return choose_port(printer) if port == AUTO else port


def _described(port: PortInfo) -> str:
    told = " ".join(filter(None, (port.usb_id, port.serial_number, port.description)))
    return f"{port.device} ({told})" if told else port.device


def locate(port: str, baud: int | str | None, printer: Printer) -> PrinterPort:
    """Find port and baud rate where one or both are `AUTO`; opens the port for `AUTO` rates only.

    Parameters
    ----------
    port : str
    baud : int, `AUTO` or None
        None for the profile's.
    printer : Printer

    Raises
    ------
    PortError
        When no port, or more than one, can be the printer's, or it can't be opened.
    HandshakeError
        When nothing answers there, at any rate tried. (At one that is given nobody is asked here:
        the print's own handshake does it.)
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


def rates_to_try(printer: Printer) -> tuple[int, ...]:
    """The profile's rate, then those of its list, each once."""
    return tuple(dict.fromkeys((printer.baud, *printer.bauds)))


def sweep(wire: TunableBaud, rates: Sequence[int], clock: Clock, resets: bool) -> int:
    """Ask at one rate after the other; give the first at which a firmware answers.

    Parameters
    ----------
    wire : TunableBaud
        Open, at the first rate.
    rates : sequence of int
    clock : Clock
    resets : bool
        Whether the board resets when its port opens, and is given time to start.

    Raises
    ------
    HandshakeError
        When nothing answers at any rate.
    PortLost
        When the port goes away.
    """
    if resets:
        _let_start(wire, clock)
    heard = 0
    for rate in [*rates] * ROUNDS:
        wire.set_baud(rate)
        wire.write(QUESTION)
        said, limit = b"", clock.now() + ANSWER_S
        while (left := limit - clock.now()) > 0:
            said += wire.read(left)
            if _ANSWER.search(said[: said.rfind(b"\n") + 1]):
                return rate
        heard += len(said)
    raise HandshakeError(
        f"no firmware answers at {', '.join(map(str, rates))} Bd ({heard} bytes heard); check that "
        "the printer is on and no other program speaks to it, or give --baud"
    )


def _let_start(wire: TunableBaud, clock: Clock) -> None:
    """Wait for the first sign of a start, and until it is over; at whatever rate, it is a sign."""
    limit = clock.now() + BOOT_LIMIT_S
    wait = FIRST_WORD_S
    while clock.now() < limit and wire.read(wait):
        wait = BOOT_QUIET_S
