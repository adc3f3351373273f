"""Complete prints on the simulated printer, in virtual time: every move executed."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.print_parts import EVERY_S
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.wiring import Wiring
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.dry_run.run import dry_run
from sim.gcode.motion.hardware import Board
from tests.printctl.machine.link.jobs import parse_job, with_codes
from tests.printctl.machine.link.journals import journal_in
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    HEADER,
    PRINTER,
    START,
    gcode,
    printed,
    same_motion,
    wire,
)
from tests.slower import first_of


def test_printer_executes_the_file_as_the_dry_run_foresaw(tmp_path):
    data, transport = gcode(500), wire()
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert same_motion(transport.printer.executed(), foreseen)
    steps = np.diff(transport.printer.executed().line)
    assert set(steps) <= {1, 2}  # nothing between the moves but a token
    assert np.count_nonzero(steps == 2) <= transport.clock.now() / EVERY_S


def test_lost_ok_costs_one_question_and_no_line(tmp_path):
    data, transport = gcode(100), wire("drop_ok@20")
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert same_motion(transport.printer.executed(), foreseen)


def test_reset_in_mid_print_ends_as_position_unknown(tmp_path):
    status, _ = printed(gcode(100), tmp_path, wire("reset@40"))
    assert status.state is LinkState.POSITION_UNKNOWN
    assert not status.position_known
    assert 38 <= status.lines_done <= 40


def test_reset_during_the_handshake_ends_as_failed_and_moves_nothing(tmp_path):
    transport = wire("reset@3")
    status, _ = printed(gcode(100), tmp_path, transport)
    assert (status.state, status.error) == (LinkState.FAILED, "HandshakeError")
    assert "reset during the handshake" in status.message
    assert len(transport.printer.executed()) == 0


def test_firmware_that_kills_itself_ends_as_killed(tmp_path):
    status, _ = printed(gcode(100), tmp_path, wire("kill@40"))
    assert status.state is LinkState.KILLED
    assert "halted itself" in status.message


def test_cold_extrusion_is_a_fault_although_the_printer_says_ok(tmp_path):
    data = gcode(100).replace(b"M302 P1\n", b"")
    status, _ = printed(data, tmp_path, wire())
    assert status.state is LinkState.FAILED
    assert "cold extrusion prevented" in status.message
    assert "line 5 of test.gcode" in status.message


def test_unknown_command_is_a_fault_although_the_printer_says_ok(tmp_path):
    """A code that the profile says the board has, and the board doesn't."""
    data = HEADER + b"M9998\n" + gcode(10)[len(HEADER) :]
    status, _ = printed(data, tmp_path, wire(), printer=with_codes(PRINTER, "M9998"))
    assert status.state is LinkState.FAILED
    assert "M9998" in status.message


class FaultAtTheEnd(SimTransport):
    """A printer that says why it didn't move while the host waits for the last moves."""

    late = b""

    def write(self, data: bytes) -> None:
        if b"M0400" in data and self.printer.executed().line.size:
            self.late = b"echo: cold extrusion prevented\n"
        super().write(data)

    def read(self, timeout: float) -> bytes:
        late, self.late = self.late, b""
        return late or super().read(timeout)


def test_fault_during_the_last_moves_is_no_finished_print(tmp_path):
    printer = MarlinPrinter(PRINTER, START)
    transport = FaultAtTheEnd(printer, VirtualClock(), np.random.default_rng(0))
    status, _ = printed(gcode(10), tmp_path, transport)
    assert status.state is LinkState.FAILED
    assert "cold extrusion prevented" in status.message


def test_controlled_stop_leaves_the_bath(tmp_path):
    transport = wire()
    streamer_at: list[Streamer] = []
    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(tmp_path),
        printer=PRINTER,
        on_status=lambda status: streamer_at[0].stop() if status.lines_done > 50 else None,
    )
    streamer_at.append(Streamer(wiring, parse_job(gcode(500), "test.gcode")))
    status = streamer_at[0].run()
    motion = transport.printer.executed()
    assert status.state is LinkState.STOPPED
    assert status.position_known
    assert motion.plunger_end[-2] < motion.plunger_start[-2]  # relieved first,
    assert motion.end[-2, 2] == motion.start[-2, 2]
    assert motion.end[-1, 2] == pytest.approx(30.0)  # then straight up
    assert np.array_equal(motion.end[-1, :2], motion.start[-1, :2])


@pytest.mark.parametrize("seed", first_of(range(10), 3))
def test_noise_lost_oks_and_delays_neither_lose_nor_double_a_line(tmp_path, seed):
    data = gcode(400)
    transport = wire(seed=seed, noise=0.0004, drop_ok=0.002, delay=0.002)
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE, status
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert same_motion(transport.printer.executed(), foreseen)
    assert read_journal(tmp_path / "journal.log").done == status.lines_total


def test_long_waits_of_the_printer_are_waited_for(tmp_path):
    data = gcode(5) + b"G4 S40\nG1 X60 F6\nM400\nM109 S30\nM104 S0\n"
    transport = wire()
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE, status
    assert transport.clock.now() > 70
    assert status.line_errors == 0


def test_firmware_that_stops_itself_is_quoted(tmp_path):
    printer = MarlinPrinter(PRINTER, START, board=Board(thermistors=False))
    status, _ = printed(
        gcode(5) + b"M109 S30\n" + gcode(5), tmp_path, SimTransport(printer, VirtualClock())
    )
    assert status.state is LinkState.KILLED
    assert "MINTEMP" in status.message


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("profiled", [False, True])
def test_kill_halts_a_printer_with_full_queues(tmp_path, parser, profiled):
    board = PRINTER.model_copy(update={"emergency_parser": parser, "advanced_ok": not parser})
    facts = board.model_copy(update={"emergency_parser": profiled})  # the board's own word counts
    printer = MarlinPrinter(board, START)
    left = threading.Event()

    class Urgent(SimTransport):
        def write_urgent(self, data: bytes) -> None:
            self.write(data)
            left.set()

    transport = Urgent(printer, VirtualClock())
    at: list[Streamer] = []

    def on_status(status: Status) -> None:
        if status.lines_done > 50 and not left.is_set():
            threading.Thread(target=at[0].kill).start()
            assert left.wait(10)

    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(tmp_path),
        printer=facts,
        on_status=on_status,
    )
    at.append(Streamer(wiring, parse_job(gcode(500), "test.gcode")))
    status = at[0].run()
    assert printer.dead
    assert status.state is LinkState.KILLED
    assert "has halted" in status.message
    assert ("motors may have run on" in status.message) != parser


class StoppedAtTheEnd(SimTransport):
    """A user who stops the print while the last moves are made."""

    def __init__(self, printer: MarlinPrinter) -> None:
        super().__init__(printer, VirtualClock())
        self.lines: list[bytes] = []
        self.streamer: Streamer | None = None

    def write(self, data: bytes) -> None:
        self.lines.append(data)
        ends = b"M0400" in data and len(self.lines) > 40
        if ends and self.streamer is not None:
            self.streamer.stop()
            self.streamer = None
        super().write(data)


def test_a_stop_during_the_last_moves_relieves_the_plunger_before_settings_are_put_back(tmp_path):
    transport = StoppedAtTheEnd(MarlinPrinter(PRINTER, START))
    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(tmp_path),
        printer=PRINTER,
        retreat=Retreat(relief_mm=0.5),
    )
    streamer = transport.streamer = Streamer(wiring, parse_job(gcode(30), "test.gcode"))
    status = streamer.run()
    assert (status.state, status.alarms) == (LinkState.STOPPED, 0), status
    assert "way out" not in status.message
    relief = next(k for k, line in enumerate(transport.lines) if b"G1 E-" in line)
    forbidden = next(k for k, line in enumerate(transport.lines) if b"M302 S170 P0" in line)
    assert relief < forbidden


def test_advanced_ok_is_understood(tmp_path):
    facts = PRINTER.model_copy(update={"advanced_ok": True})
    data = gcode(200)
    transport = SimTransport(MarlinPrinter(facts, START), VirtualClock())
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE
    assert status.line_errors == 0
