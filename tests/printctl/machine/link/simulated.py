"""Test job of moves, its prints on the simulated Marlin, and what they must have made."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from gcode.dry_run.run import dry_run
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.care import Care
from printctl.machine.job.job import Job
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.transport import Transport
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import parse_fault
from tests.printctl.machine.link.jobs import journal_in, parse_job
from tests.printctl.machine.link.sim_transport import SimTransport

PRINTER = load(Printer, "generic_marlin")
START = (50.0, 50.0, 10.0)
HEADER = b"M302 P1\nG90\nM82\nM85 S600\nG92 X50 Y50 Z10 E0\n"


def gcode(moves: int, header: bytes = HEADER) -> bytes:
    """A zigzag whose segments are longer than the firmware's least steps."""
    lines = [
        b"G1 X%.3f Y%.3f E%.5f F1800" % (50 + i % 2 * 3.5, 50 + i % 40 * 0.25, 0.0035 * (i + 1))
        for i in range(moves)
    ]
    return header + b"\n".join(lines) + b"\n"


def wired(
    transport: Transport,
    folder: Path,
    job: Job | bytes,
    printer: Printer = PRINTER,
    care: Care | None = None,
    **wiring: Any,
) -> Streamer:
    """A streamer of a job on a wire, its journal in ``folder``; Marlin's unless told otherwise."""
    wiring = {"protocol": MarlinProtocol(), "clock": transport.clock, **wiring}
    if "journal" not in wiring:
        wiring["journal"] = journal_in(folder)
    if isinstance(job, bytes):
        job = parse_job(job, "test.gcode", printer)
    return Streamer(Wiring(transport=transport, printer=printer, **wiring), job, care)


def printed(
    data: bytes,
    folder: Path,
    transport: SimTransport,
    *requests: str,
    on_status: Callable[[Status], None] | None = None,
    keep: list[Streamer] | None = None,
    **wiring: Any,
) -> tuple[Status, Streamer]:
    """Print; without ``on_status`` each pause is resumed at once."""

    def go_on(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            streamer.resume()

    streamer = wired(transport, folder, data, on_status=on_status or go_on, **wiring)
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


def foreseen(data: bytes) -> ExecutedMotion:
    """Moves that the dry run of a file makes."""
    return dry_run(data, PRINTER, START, cold_extrusion=True).executed


def strokes(motion: ExecutedMotion) -> NDArray[np.float64]:
    """Moves across: the head, where each begins and ends, and what its plunger does in it."""
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    pushed = motion.plunger_end - motion.plunger_start
    return np.column_stack([motion.tool, motion.start, motion.end, pushed])[across]


def assert_same_strokes(
    motion: ExecutedMotion, expected: ExecutedMotion, plunger_mm: float = 1e-9
) -> None:
    """No stroke lost, doubled or by the wrong head, and the same ink in each."""
    ours, theirs = strokes(motion), strokes(expected)
    assert ours.shape == theirs.shape
    np.testing.assert_array_equal(ours[:, :7], theirs[:, :7])
    np.testing.assert_allclose(ours[:, 7], theirs[:, 7], atol=plunger_mm)
