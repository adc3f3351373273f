"""Controlled stop on Marlin: M410 discards planned moves; the retreat starts there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.wiring import Wiring
from sim.devices.families.marlin.printer import MarlinPrinter
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.journals import journal_in
from tests.printctl.machine.link.sim_transport import SimTransport

PRINTER = load(Printer, "generic_marlin")
HEADER = "M302 P1\nG90\nM82\nM85 S600\n"


class Unreadable(SimTransport):
    """A wire that garbles each answer to M114 once the moves were dropped."""

    stopping = False

    def write(self, data: bytes) -> None:
        self.stopping |= b"M410" in data
        super().write(data)

    def read(self, timeout: float) -> bytes:
        data = super().read(timeout)
        return data.replace(b"Z:", b"Z;") if self.stopping else data


def stopped(
    moves: str, folder: Path, kind: type[SimTransport] = SimTransport
) -> tuple[Status, SimTransport, float]:
    """Print until 40 lines were taken, then stop; also give when that was asked for, s."""
    printer = MarlinPrinter(PRINTER, (50.0, 50.0, 10.0))
    transport = kind(printer, VirtualClock(), np.random.default_rng(0))
    asked: list[float] = []

    def stop_once(status: Status) -> None:
        if status.lines_done > 40 and not asked:
            asked.append(transport.clock.now())
            streamer.stop()

    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(folder),
        printer=PRINTER,
        on_status=stop_once,
    )
    streamer = Streamer(wiring, parse_job((HEADER + moves).encode(), "test.gcode"))
    return streamer.run(), transport, asked[0]


def test_the_moves_that_the_planner_holds_are_dropped(tmp_path):
    """As on a real Marlin; only what waited for room is made first."""
    place = "G92 X50 Y50 Z10 E0\n"
    moves = "".join(f"G1 X{20 + 20 * (k % 2)} E{k / 10:.1f} F1200\n" for k in range(1, 200))
    status, transport, asked_s = stopped(place + moves, tmp_path)
    motion = transport.printer.executed()
    sideways = np.flatnonzero(np.any(motion.end[:, :2] != motion.start[:, :2], axis=1))
    assert motion.time_end[sideways[-1]] < asked_s + 2.1  # moves of 1 s; sixteen were ahead
    assert np.array_equal(motion.end[-1, :2], motion.end[sideways[-1], :2])  # straight up
    assert motion.plunger_end[-2] < motion.plunger_end[sideways[-1]]
    assert status.state is LinkState.STOPPED
    assert "what it held ahead wasn't made" in status.message
    assert status.lines_done > 40 > status.lines_executed


def test_a_stop_whose_position_cant_be_read_ends_with_a_sentence(tmp_path):
    """The job names Y alone, so that nobody knows X."""
    moves = "".join(f"G1 Y{20 + 20 * (k % 2)} F1200\n" for k in range(1, 200))
    status, _, _ = stopped("G92 E0\n" + moves, tmp_path, Unreadable)
    assert status.state is LinkState.STOPPED
    assert "where it stands can't be read" in status.message
    assert not status.position_known
