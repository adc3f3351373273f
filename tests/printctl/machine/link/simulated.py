"""Test job of moves, and its prints on the simulated Marlin in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journal import Journal
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.wiring import Wiring
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.faults import parse_fault
from sim.gcode.motion.executed import ExecutedMotion
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.journals import journal_in
from tests.printctl.machine.link.sim_transport import SimTransport

PRINTER = load(Printer, "generic_marlin")
START = (50.0, 50.0, 10.0)
HEADER = b"M302 P1\nG90\nM82\nM85 S600\nG92 X50 Y50 Z10 E0\n"


def gcode(moves: int) -> bytes:
    """A zigzag whose segments are longer than the firmware's least steps."""
    lines = [
        b"G1 X%.3f Y%.3f E%.5f F1800" % (50 + i % 2 * 3.5, 50 + i % 40 * 0.25, 0.0035 * (i + 1))
        for i in range(moves)
    ]
    return HEADER + b"\n".join(lines) + b"\n"


def printed(
    data: bytes,
    folder: Path,
    transport: SimTransport,
    *requests: str,
    printer: Printer = PRINTER,
    on_status: Callable[[Status], None] | None = None,
    journal: Journal | None = None,
    keep: list[Streamer] | None = None,
) -> tuple[Status, Streamer]:
    """Print; without ``on_status`` each pause is resumed at once."""

    def go_on(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            streamer.resume()

    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal or journal_in(folder),
        printer=printer,
        on_status=on_status or go_on,
    )
    streamer = Streamer(wiring, parse_job(data, "test.gcode", printer))
    if keep is not None:
        keep.append(streamer)
    for request in requests:
        getattr(streamer, request)()
    return streamer.run(), streamer


def wire(*faults: str, seed: int = 0, **troubles: float) -> SimTransport:
    printer = MarlinPrinter(PRINTER, START, faults=tuple(parse_fault(text) for text in faults))
    return SimTransport(printer, VirtualClock(), np.random.default_rng(seed), **troubles)


def same_motion(one: ExecutedMotion, other: ExecutedMotion) -> bool:
    """Whether the same moves were made; line numbers shift where M114 was asked in passing."""
    return np.array_equal(one.end, other.end) and np.array_equal(one.plunger_end, other.plunger_end)
