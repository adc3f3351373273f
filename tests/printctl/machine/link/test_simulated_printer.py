"""Complete prints on the simulated printer, in virtual time: every move executed."""

from __future__ import annotations

import threading
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gcode.motion.state import Board
from printctl.machine.control.printing.printing import COUNT_ANSWERS_S
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from printctl.pipeline.past.past_print import entry_of
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import Fault, PermanentFaults
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
from tests.slower import first_of, first_rows


def test_printer_executes_the_file_as_the_dry_run_foresaw(tmp_path):
    data, transport = gcode(500), wire()
    status, _ = printed(data, tmp_path, transport)
    assert status.state is LinkState.DONE
    assert same_motion(transport.printer.executed(), foreseen(data))
    steps = np.diff(transport.printer.executed().line)
    assert set(steps) <= {1, 2}  # nothing between the moves but a token
    assert np.count_nonzero(steps == 2) <= transport.clock.now() / COUNT_ANSWERS_S


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
        def write_halt(self, data: bytes) -> None:
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
    assert "confirmed the halt" in status.message
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


# --- late or bunched oks and slow boards: done is reported after the last motor step
MOVES = 40
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


def late_oks(seed: int, up_to_s: float, first: int = 0) -> dict[str, object]:
    """Delays of 300 oks by chance, of the first ones none."""
    delays = np.random.default_rng(seed).uniform(0, up_to_s, 300 - first)
    return {"ok_delays_s": [0.0] * first + delays.tolist()}


OK_DELAYS = [(0, 0, 0, 3), (3,), (0, 1.5, 0, 0, 1), (0, 0, 2)]
ROWS = [((), seed, late_oks(seed, 5.0, first=30)) for seed in (0, 3, 1, 2)]
ROWS += [((), seed, late_oks(seed, 5.0)) for seed in (0, 3)]
ROWS += [((), 0, {"speed": share}) for share in (0.3, 0.5)]
ROWS += [((), 0, {"ok_delays_s": delays}) for delays in OK_DELAYS]
STALLED = ((STALL,), 3, {"speed": 0.5, "drop_ok": 0.05} | late_oks(3, 0.8))


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
        assert "can't be read" in status.message


@pytest.mark.parametrize(
    ("faults", "seed", "troubles"), first_rows([STALLED, *ROWS[::2], *ROWS[1::2]], 8)
)
def test_late_oks_and_slow_boards(tmp_path, faults, seed, troubles):
    """An answer to an earlier question is none to a later doubt's, and no sign of a reset."""
    transport = wire_slow_boards(*faults, seed=seed, **troubles)
    check_print(transport, tmp_path)
    if share := troubles.get("speed"):
        assert transport.clock.now() > transport.printer.now / share * 0.99


# --- repeated alarms are counted; whoever stopped a print is reported
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
