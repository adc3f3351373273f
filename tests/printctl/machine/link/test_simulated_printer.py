"""Complete prints on the simulated printer, in virtual time: every move executed."""

from __future__ import annotations

import re
import threading
from contextlib import closing
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from printctl.machine.control.place import SOONEST_LINES
from printctl.machine.control.printing import COUNT_ANSWERS_S
from printctl.machine.control.streamer import Streamer
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.replay import read_journal, read_journal_if_any
from printctl.machine.records.states import LinkState, Status
from printctl.pipeline.past_print import entry_of
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.faults import Fault, PermanentFaults
from sim.gcode.motion.hardware import Board
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    START,
    foreseen,
    gcode,
    printed,
    same_motion,
    wire,
    wired,
)
from tests.printctl.machine.link.simulated_transport import SimulatedTransport
from tests.printctl.machine.link.test_streamer import job_of, streamer_of
from tests.slower import first_of


def test_printer_executes_the_file_as_the_dry_run_foresaw(tmp_path):
    data, transport = gcode(500), wire()
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE
    assert same_motion(transport.printer.executed(), foreseen(data))
    steps = np.diff(transport.printer.executed().line)
    assert set(steps) <= {1, 2}  # nothing between the moves but a token
    assert np.count_nonzero(steps == 2) <= transport.clock.now() / COUNT_ANSWERS_S


def test_reset_during_the_handshake_ends_as_failed_and_moves_nothing(tmp_path):
    transport = wire("reset@3")
    status, _ = printed(gcode(100), tmp_path, transport)
    assert (status.state, status.error) == (LinkState.FAILED, "HandshakeError")
    assert "reset during the handshake" in status.message
    assert len(transport.printer.executed()) == 0


def test_cold_extrusion_is_a_fault_although_the_printer_says_ok(tmp_path):
    data = gcode(100).replace(b"M302 P1\n", b"")
    status, _ = printed(data, tmp_path, wire())
    assert status.state is LinkState.FAILED
    assert "cold extrusion prevented" in status.message
    assert "line 5 of test.gcode" in status.message


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

    def on_status(status: Status) -> None:
        if status.lines_done > 50:
            streamer.stop()

    streamer = wired(transport, tmp_path, gcode(500), on_status=on_status)
    status = streamer.run()
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
    assert same_motion(transport.printer.executed(), foreseen(data))
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

    def on_status(status: Status) -> None:
        if status.lines_done > 50 and not left.is_set():
            threading.Thread(target=streamer.kill).start()
            assert left.wait(10)

    streamer = wired(transport, tmp_path, gcode(500), facts, on_status=on_status)
    status = streamer.run()
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
    streamer = wired(transport, tmp_path, gcode(30), retreat=Retreat(relief_mm=0.5))
    transport.streamer = streamer
    status = streamer.run()
    assert (status.state, status.alarms) == (LinkState.STOPPED, 0), status
    assert "way out" not in status.message
    relief = next(k for k, line in enumerate(transport.lines) if b"G1 E-" in line)
    forbidden = next(k for k, line in enumerate(transport.lines) if b"M302 S170 P0" in line)
    assert relief < forbidden


# --- ends whose motors stand some steps off: a last move too short to be made, and a fault
@pytest.mark.parametrize("moves", [3, 40])
def test_last_move_below_the_firmwares_least_steps_is_no_renamed_place(tmp_path, moves):
    """Seen on a real Marlin: 5 steps of X and Y short of the place that it tells."""
    last = 50 + (moves - 1) % 2 * 3.5
    status, _ = printed(gcode(moves) + b"G1 X%.4f\n" % (last + 0.0625), tmp_path, wire())
    assert status.state is LinkState.DONE
    assert status.position_known


@pytest.mark.parametrize(("axis", "steps"), [("X", 4), ("Z", 6), ("X", -4), ("Z", -6)])
def test_motors_some_steps_off_behind_a_long_last_move_are_not_done(tmp_path, axis, steps):
    class Off(FakeMarlin):
        def _do(self, command: str) -> bytes:
            if command.startswith(last):
                self.renamed_mm[axis] -= steps / {"X": 80, "Z": 400}[axis]
            return super()._do(command)

    job = zigzag(60)
    last = job[-1].decode()
    for printer, state in ((FakeMarlin(), LinkState.DONE), (Off(), LinkState.POSITION_UNKNOWN)):
        folder = tmp_path / state
        folder.mkdir()
        transport = FakeTransport(printer, VirtualClock())
        assert streamer_of(job_of(job), transport, folder).run().state is state
    checkpoint = read_journal(folder / "journal.log").checkpoint
    assert checkpoint is not None
    assert "plunger isn't compared" in checkpoint["compared"]


@pytest.mark.parametrize("bed", [True, False])
def test_a_printer_without_bed_is_not_told_to_switch_it_off(tmp_path, bed):
    bare = PRINTER.model_copy(update={"safe_state_on": ()})

    class Bare(FakeMarlin):
        def _reply(self, word: str, command: str) -> str:
            said = super()._reply(word, command)
            return said if bed else said.replace(" B:21.00 /0.00", "").replace(" B@:0", "")

    printer = Bare()
    streamer = streamer_of(
        job_of([*zigzag(60), *[b"M105"] * 3000]),
        FakeTransport(printer, VirtualClock()),
        tmp_path,
        lambda status: streamer.stop() if status.lines_done > 10 else None,
        printer=bare,
    )
    assert streamer.run().state is LinkState.STOPPED
    assert ("M140 S0" in printer.numbered) is bed


# --- late or bunched oks and slow boards: done is reported after the last motor step
MOVES = 40
LATE = Fault(fault="late_oks", line=30, seconds=5.0)
STALL = Fault(fault="stall", line=30, seconds=4.0)


def wire_slow_boards(*faults: Fault, seed: int = 0, **troubles: object) -> SimulatedTransport:
    return SimulatedTransport(
        MarlinPrinter(PRINTER, START, faults=faults),
        VirtualClock(),
        PermanentFaults.model_validate(troubles),
        np.random.default_rng(seed),
    )


def last_step_s(transport: SimulatedTransport) -> float:
    """When the motors stood, on the host's clock, s; all that was accepted is run first."""
    transport.printer.finish()
    board_s = float(transport.printer.executed().time_end[-1])
    return transport.printer.pace.host_time(board_s)


def check_print(transport: SimulatedTransport, folder: Path) -> None:
    """Print; done must be said behind the last step, and each move be made once."""
    data = gcode(MOVES)
    status, _ = printed(data, folder, transport)
    said_s = transport.clock.now()
    assert status.state is LinkState.DONE, status
    assert said_s >= last_step_s(transport)
    assert same_motion(transport.printer.executed(), foreseen(data))


@pytest.mark.parametrize("seed", first_of([0, 3, 1, 2]))
def test_each_ok_late_by_up_to_five_seconds(tmp_path, seed):
    check_print(wire_slow_boards(LATE, seed=seed), tmp_path)


@pytest.mark.parametrize("delays", first_of([(0, 0, 0, 3), (3,), (0, 1.5, 0, 0, 1), (0, 0, 2)], 3))
def test_oks_that_come_bunched(tmp_path, delays):
    check_print(wire_slow_boards(ok_delays_s=delays), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("delays", [(2, 0), (0, 5)])
def test_oks_of_which_every_second_is_late_are_refused_and_no_move_is_made_twice(tmp_path, delays):
    """The link gives up after `TRIES` tokens: late oks look as if each token were lost."""
    transport, data = wire_slow_boards(ok_delays_s=delays), gcode(MOVES)
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.FAILED, status
    transport.printer.finish()
    if status.lines_done:  # told at the latest once the last line was taken
        assert not status.position_known
        assert status.lines_done == status.lines_total
        assert same_motion(transport.printer.executed(), foreseen(data))
    else:
        assert "can't be understood" in status.message


@pytest.mark.parametrize("seed", first_of([0, 3]))
def test_all_answers_late_by_up_to_five_seconds_from_the_handshake_on(tmp_path, seed):
    """An answer to an earlier question is none to a later doubt's, and no sign of a reset."""
    check_print(wire_slow_boards(seed=seed, ok_delay_up_to_s=5.0), tmp_path)


@pytest.mark.parametrize("share", first_of([0.3, 0.5]))
def test_board_at_a_share_of_its_speed(tmp_path, share):
    transport = wire_slow_boards(speed=share)
    check_print(transport, tmp_path)
    assert transport.clock.now() > transport.printer.now / share * 0.99


def test_slow_board_that_stalls_behind_late_and_lost_oks(tmp_path):
    transport = wire_slow_boards(STALL, seed=3, speed=0.5, ok_delay_up_to_s=0.8, drop_ok=0.05)
    check_print(transport, tmp_path)


# --- lines garbled past the checksum: found by comparing positions
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


@pytest.mark.parametrize("seed", first_of(range(6), 3))
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
    """Comparisons fall on a slipped line in some prints only; one that would stay ends others."""
    told = []
    for seed in range(5):
        folder = tmp_path / str(seed)
        folder.mkdir()
        printer, rng = MarlinPrinter(PRINTER, START), np.random.default_rng(seed)
        transport = StrayingTransport(printer, VirtualClock(), rng, noise=0.001)
        status, _ = printed(gcode(600), folder, transport)
        slipped = "X is 51.00 mm where the job says 5"
        assert status.state is LinkState.DONE or slipped in status.message
        alarms = read_journal(folder / "journal.log").alarms
        told += [text for text in alarms if "slipped through its checksum" in text]
    assert len(told) > 1
    assert all(slipped in text for text in told)


def test_clean_line_is_never_held_up_for_a_comparison(tmp_path):
    printer = MarlinPrinter(PRINTER, START)
    printed(gcode(600), tmp_path, SimTransport(printer, VirtualClock()))
    history = read_journal(tmp_path / "journal.log")
    assert history.checkpoint is not None
    assert history.checkpoint["done"] == history.done  # at the end alone


# --- repeated alarms are counted; whoever stopped a print is reported
class Doubled(SimTransport):
    """A bridge that repeats each of the printer's answers."""

    def __init__(self) -> None:
        super().__init__(MarlinPrinter(PRINTER, START), VirtualClock())
        self._rest = b""

    def read(self, timeout: float) -> bytes:
        whole, end, self._rest = (self._rest + super().read(timeout)).rpartition(b"\n")
        lines = (whole + end).splitlines(keepends=True)
        return b"".join(line * 2 if line.startswith(b"ok") else line for line in lines)


def test_answers_that_are_all_doubled_make_one_alarm_with_a_count(tmp_path):
    status, _ = printed(gcode(60), tmp_path, Doubled())
    assert status.state is LinkState.DONE
    assert status.alarms == 1
    journal = tmp_path / "journal.log"
    (text,) = read_journal(journal).alarms
    times = int(text.rsplit("(", 1)[1].removesuffix(" times)"))
    assert times > 30
    assert "another program or noise wrote to this printer" in text
    assert read_journal_if_any(journal).last_alarm == text
    assert journal.read_text().count(" alarm") + journal.read_text().count('"repeated"') < 12


def test_history_tells_an_alarm_once(tmp_path):
    path = tmp_path / "journal.log"
    with closing(Journal(path)) as journal:
        journal.add("job", name="a.gcode", started=1.0, lines=3)
        journal.add("alarm", text="1 ok too many")
        journal.add("alarm", text="too warm")
        journal.add("repeated", first="1 ok too many", text="2 oks too many", times=2)
        journal.add("repeated", first="1 ok too many", text="9 oks too many", times=8)
    entry = entry_of(path)
    assert entry is not None
    texts = ["9 oks too many (8 times)", "too warm"]
    assert [alarm.text for alarm in entry.alarms] == read_journal(path).alarms == texts


class Cancelling(SimTransport):
    """A board on which somebody presses Cancel."""

    def __init__(self) -> None:
        super().__init__(MarlinPrinter(PRINTER, START), VirtualClock())
        self._pressed = False

    def read(self, timeout: float) -> bytes:
        said = super().read(timeout)
        if self.clock.now() > 2.0 and not self._pressed and said.endswith(b"\n"):
            self._pressed = True
            return said + b"//action:cancel\n"
        return said


def test_a_cancel_of_the_board_is_told_as_the_boards(tmp_path):
    status, _ = printed(gcode(400), tmp_path, Cancelling())
    assert status.state is LinkState.STOPPED
    assert "stopped by the printer (//action:cancel)" in status.message
