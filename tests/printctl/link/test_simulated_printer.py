"""Complete prints on the simulated printer, in virtual time: the file is executed."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from printctl.link.answer_count import EVERY_S
from printctl.link.clock import VirtualClock
from printctl.link.journal import read_journal
from printctl.link.retreat import Retreat
from printctl.link.slips import SOONEST_LINES
from printctl.link.states import LinkState, Status
from printctl.link.streamer import Streamer
from printctl.link.transport_simulated import HostDiedError
from printctl.link.wiring import Wiring
from sim.board.hardware import Board
from sim.dryrun import dry_run
from sim.executed import ExecutedMotion
from sim.families.marlin.printer import MarlinPrinter
from sim.faults import parse_fault
from tests.printctl.link.jobs import parse_job, with_codes
from tests.printctl.link.journals import journal_in
from tests.printctl.link.layered import doomed
from tests.printctl.link.sim_transport import SimTransport

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
    *wishes: str,
    printer: Printer = PRINTER,
    on_status: Callable[[Status], None] = lambda status: None,
) -> tuple[Status, Streamer]:
    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(folder),
        printer=printer,
        on_status=on_status,
    )
    streamer = Streamer(wiring, parse_job(data, "test.gcode", printer))
    for wish in wishes:
        getattr(streamer, wish)()
    return streamer.run(), streamer


def wire(*faults: str, seed: int = 0, **troubles: float) -> SimTransport:
    printer = MarlinPrinter(PRINTER, START, faults=tuple(parse_fault(text) for text in faults))
    return SimTransport(printer, VirtualClock(), np.random.default_rng(seed), **troubles)


def same_motion(one: ExecutedMotion, other: ExecutedMotion) -> bool:
    """Whether the same moves were made; line numbers shift where M114 was asked in passing."""
    return np.array_equal(one.end, other.end) and np.array_equal(one.plunger_end, other.plunger_end)


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


@pytest.mark.parametrize("seed", range(10))
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
        if b"M0400" in data and self.streamer is not None:
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


def resumed(data: bytes, folder: Path, transport: SimTransport) -> Status:
    history = read_journal(folder / "journal.log")
    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(folder),
        printer=PRINTER,
    )
    return Streamer(wiring, parse_job(data, "test.gcode")).run(history)


def test_host_killed_in_a_pause_comes_down_and_primes_again(tmp_path):
    data, transport = gcode(300), wire()
    at: list[Streamer] = []

    def on_status(status: Status) -> None:
        if status.state is LinkState.PRINTING and status.lines_done > 50:
            at[0].pause()
        if status.state is LinkState.PAUSED:
            raise HostDiedError

    wiring = Wiring(
        transport=transport,
        protocol=MarlinProtocol(),
        clock=transport.clock,
        journal=journal_in(tmp_path),
        printer=PRINTER,
        on_status=on_status,
    )
    at.append(Streamer(wiring, parse_job(data, "test.gcode")))
    with pytest.raises(HostDiedError):
        at[0].run()
    lifted = transport.printer.executed().end[-1]
    assert lifted[2] == pytest.approx(30.0)
    status = resumed(data, tmp_path, SimTransport(transport.printer, transport.clock))
    assert status.state is LinkState.DONE, status
    motion = transport.printer.executed()
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert np.array_equal(motion.end[-1], foreseen.end[-1])
    assert motion.plunger_end[-1] == foreseen.plunger_end[-1]
    assert len(motion) == len(foreseen) + 13  # relieve, lift, ten steps down, prime


def test_printer_reset_while_the_host_was_dead_is_position_unknown(tmp_path):
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    with pytest.raises(HostDiedError):
        printed(data, tmp_path, doomed(printer, clock, 60, 1.0))
    printer.reset()
    printer.settle()
    printer.take_output()
    before = len(printer.executed())
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.POSITION_UNKNOWN
    assert len(printer.executed()) == before


@pytest.mark.parametrize("seed", range(25))
def test_host_killed_twice_at_random_moments_goes_on_exactly(tmp_path, seed):
    rng = np.random.default_rng(seed)
    data, printer, clock = gcode(60), MarlinPrinter(PRINTER, START), VirtualClock()
    transport, last, part = SimTransport(printer, clock), int(rng.integers(1, 60)), rng.random()

    def arm(status: Status) -> None:
        if status.state is LinkState.PRINTING and status.lines_done == 0:
            transport.die_at(last, part)

    with pytest.raises(HostDiedError):
        printed(data, tmp_path, transport, on_status=arm)
    with pytest.raises(HostDiedError):
        resumed(data, tmp_path, doomed(printer, clock, int(rng.integers(1, 9)), 0.5))
    status = resumed(data, tmp_path, SimTransport(printer, clock))
    assert status.state is LinkState.DONE, status
    motion = printer.executed()
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert np.array_equal(motion.end, foreseen.end)
    assert np.array_equal(motion.plunger_end, foreseen.plunger_end)


class SlippingTransport(SimTransport):
    """From N300 on, once: an X becomes a Z on its way, and the checksum is right.

    No other noise garbles that line, else it is refused and nothing has slipped.
    """

    slipped = False
    _slip = b""

    def on_the_way(self, data: bytes) -> bytes:
        slip, self._slip = self._slip, b""
        return data if slip else super().on_the_way(data)

    def write(self, data: bytes) -> None:
        moves = re.match(rb"N(\d+) G1 X", data)
        if moves and int(moves[1]) >= 300 and not self.slipped:
            self.slipped = True
            body = data.split(b"*")[0].replace(b"X", b"Z")
            data = self._slip = b"%b*%d\n" % (body, reduce(xor, body))
        super().write(data)


@pytest.mark.parametrize("seed", range(6))
def test_word_that_slipped_through_is_found_soon_on_a_noisy_line(tmp_path, seed):
    printer = MarlinPrinter(PRINTER, START)
    transport = SlippingTransport(
        printer, VirtualClock(), np.random.default_rng(seed), noise=0.0004, drop_ok=0.01
    )
    status, _ = printed(gcode(2000), tmp_path, transport)
    assert transport.slipped
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 5" in status.message
    assert status.lines_done < 340


class NoisyOnce(SimTransport):
    """Line 295 is garbled; the X of line 300 becomes a Z, and the checksum is right."""

    garbled = False
    lines = gcode(2000).splitlines()

    def write(self, data: bytes) -> None:
        if b" %b*" % self.lines[294] in data and not self.garbled:
            self.garbled, data = True, data.replace(b"G1", b"G3")
        if b" %b*" % self.lines[299] in data:
            body = data.split(b"*")[0].replace(b"X", b"Z")
            data = b"%b*%d\n" % (body, reduce(xor, body))
        super().write(data)


def test_height_that_slipped_ends_the_print_at_the_first_comparison(tmp_path):
    transport = NoisyOnce(MarlinPrinter(PRINTER, START), VirtualClock())
    status, _ = printed(gcode(2000), tmp_path, transport)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 5" in status.message
    assert 300 <= status.lines_done <= 300 + 2 * SOONEST_LINES


class StrayingTransport(SimTransport):
    """One line in 31 goes to another X, and the checksum is right."""

    def write(self, data: bytes) -> None:
        if data.startswith(b"N") and int(data.split()[0][1:]) % 31 == 0:
            body = re.sub(rb" X\S+", b" X51.000", data.split(b"*")[0])
            data = b"%b*%d\n" % (body, reduce(xor, body))
        super().write(data)


def test_word_that_slipped_through_and_was_given_again_is_told(tmp_path):
    """A comparison falls on a slipped line in some prints only: six of them are asked together."""
    told = []
    for seed in range(6):
        folder = tmp_path / str(seed)
        folder.mkdir()
        printer, rng = MarlinPrinter(PRINTER, START), np.random.default_rng(seed)
        transport = StrayingTransport(printer, VirtualClock(), rng, noise=0.001)
        status, _ = printed(gcode(600), folder, transport)
        assert status.state is LinkState.DONE, status
        alarms = read_journal(folder / "journal.log").alarms
        told += [text for text in alarms if "slipped through its checksum" in text]
    assert len(told) > 3
    assert all("X is 51.00 mm where the job says 5" in text for text in told)


def test_clean_line_is_never_held_up_for_a_comparison(tmp_path):
    printer = MarlinPrinter(PRINTER, START)
    printed(gcode(600), tmp_path, SimTransport(printer, VirtualClock()))
    assert read_journal(tmp_path / "journal.log").checkpoint is None
