"""Test job with marks, and scripted interruptions of its print."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_profiles import Printer
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.transport import Transport
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin_printer import MarlinPrinter
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import HEADER, PRINTER, wired

RETRACT_MM = 0.25


def layered(layers: int, moves: int, mark: str = "LAYER_END") -> bytes:
    """Zigzag layers; each ends relieved, lifted and marked, and the next one primes first."""
    text, e = [HEADER.rstrip().decode()], 0.0
    for layer in range(layers):
        z = 10.0 + 0.25 * layer
        if layer:
            text += [f"G0 X50 Y{51 + layer % 3:g} F6000", f"G1 E{e:.5f} F60"]
        for k in range(moves):
            e += 0.0035
            x, y = 50 + (k + layer + 1) % 2 * 3.5, 50 + k % 40 * 0.25
            text.append(f"G1 X{x:.3f} Y{y:.3f} E{e:.5f} F1800")
        text += [f"G1 E{e - RETRACT_MM:.5f} F60", f"G0 Z{z + 0.25:g} F300"]
        text += [f";{mark}:{layer}", ";RELOAD"]
    return ("\n".join(text) + "\nM400\n").encode()


@dataclass
class Script:
    """What a user does: told of each status and of each job line that the printer takes."""

    streamer: Streamer | None = None
    seen: list[Status] = field(default_factory=list)
    on_paused: Callable[[Streamer], None] = lambda streamer: streamer.resume()
    at_line: dict[int, Callable[[Streamer], None]] = field(default_factory=dict)

    def status(self, status: Status) -> None:
        self.seen.append(status)
        if status.state is LinkState.PAUSED and self.streamer is not None:
            self.on_paused(self.streamer)

    def took(self, line: int) -> None:
        request = self.at_line.pop(line, None)
        if request is not None and self.streamer is not None:
            request(self.streamer)

    @property
    def pauses(self) -> list[Status]:
        return [one for one in self.seen if one.state is LinkState.PAUSED]


def played(
    data: bytes,
    folder: Path,
    transport: Transport,
    script: Script,
    care: Care | None = None,
    history: JournalledPrint | None = None,
    printer: Printer = PRINTER,
    **wiring: Any,
) -> Status:
    script.streamer = wired(
        transport, folder, data, printer, care, on_status=script.status, **wiring
    )
    return script.streamer.run(history)


def doomed(printer: MarlinPrinter, clock: VirtualClock, last: int, part: float) -> SimTransport:
    """A wire whose host dies in its ``last``-th write from now; a part of that write leaves."""
    transport = SimTransport(printer, clock)
    transport.die_at(last, part)
    return transport


class Arming(Script):
    """Lets the host die in the ``last``-th write after the print begins to pause."""

    def __init__(self, transport: SimTransport, last: int, part: float, **requests: Any) -> None:
        super().__init__(**requests)
        self._transport, self._last, self._part = transport, last, part
        self.armed = False

    def status(self, status: Status) -> None:
        if status.state is LinkState.PAUSING and not self.armed:
            self._transport.die_at(self._last, self._part)
            self.armed = True
        super().status(status)
