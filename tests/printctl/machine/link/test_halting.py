"""Run-on time of motors after a kill: within 20 % of a real Marlin's."""

from __future__ import annotations

import math
import random
import re
import threading
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_profiles import Printer, load
from gcode.motion.executed import ExecutedMotion
from gcode.reading import GcodeLine, read_sent
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.halting import Kill, halting_of
from printctl.machine.control.board.progress import JobProgress
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job import coordinates
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.job import Job
from printctl.machine.job.moves import MotorRunOn, planned_moves
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.families.registry import simulated_printer
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import HEADER as SIM_HEADER
from tests.printctl.machine.link.simulated import wired
from tests.printctl.machine.link.stepping import ExchangeOf


@pytest.mark.parametrize(
    ("feed", "real_s"), [(600, 0.638), (3000, 0.715), (6000, 0.843), (12000, 1.27)]
)
def test_message_tells_the_time_that_was_measured(feed: int, real_s: float) -> None:
    """X and Y alike, 80 steps/mm (2026-11-22, ATmega2560 under simavr)."""
    printer = load(Printer, "marlin_avr")
    halting = halting_of(printer, b"M112\n", emergency_parser=False)
    lines = [b"G92 X0 Y0 Z1", b"G1 X300 Y300 F%d" % feed, b"G1 X0 Y0"]
    told = halting.words(progress_of(lines, 2, printer).run_on(0.0), stopped=False)
    found = re.search(r"up to ([\d.]+) s", told)
    assert found is not None
    assert real_s <= float(found[1]) + 0.005 <= 1.2 * real_s


def progress_of(lines: list[bytes], done: int, printer: Printer) -> JobProgress:
    """A job of which ``done`` lines were taken."""
    wiring = SimpleNamespace(printer=printer, protocol=SimpleNamespace(lines_done=done))
    return JobProgress(wiring, Job(lines, list(range(1, len(lines) + 1)), "", "a"))


class Wire:
    """Counts what is written at once."""

    def __init__(self) -> None:
        self.written = threading.Event()

    def write_halt(self, data: bytes) -> None:
        self.written.set()


@pytest.mark.parametrize(
    ("parser", "expected"), [(True, {"M410": 0.25, "M112": 2801.0}), (False, {"M112": 0.25})]
)
def test_each_command_of_a_halt_is_told_with_its_own_time(monkeypatch, parser, expected):
    """A write takes 0.25 ms; the printer answers 40 ms after M112."""
    clock, printer = VirtualClock(), load(Printer, "marlin_avr")

    def write_halt(data: bytes) -> None:
        clock.sleep(0.25e-3)
        if b"M112" in data:
            kill.halted()

    def wait(seconds: float) -> bool:
        clock.sleep(0.04 if kill._halted.is_set() else seconds)
        return kill._halted.is_set()

    kill = Kill(
        SimpleNamespace(
            transport=SimpleNamespace(write_halt=write_halt),
            clock=clock,
            exchange=ExchangeOf(clock),
            printer=printer.model_copy(update={"emergency_parser": parser, "lines_in_flight": 1}),
            protocol=SimpleNamespace(kill_bytes=b"\nM112\n"),
        )
    )
    monkeypatch.setattr(kill._halted, "wait", wait)
    kill.strike()
    words = kill.words(None)
    told = {
        what: float(ms) for what, ms in re.findall(r"(M\d+) left the host after ([\d.]+)", words)
    }
    assert told == pytest.approx(expected, abs=0.06)
    later = re.search(r"halt (\d+) ms later", words)
    assert later is not None
    assert int(later[1]) == 40


@pytest.mark.parametrize(
    ("says_something", "told"),
    [
        (True, "stopped at M410 at the latest"),
        (False, "may have run on for up to 0.6"),
    ],
)
def test_only_a_board_that_lived_between_has_obeyed_the_quickstop(says_something, told):
    """One that stood still finds M410 and M112 together, and looks at M112 first."""
    wire, clock, printer = Wire(), VirtualClock(), load(Printer, "marlin_avr")
    wiring = SimpleNamespace(
        transport=wire,
        clock=clock,
        exchange=ExchangeOf(clock),
        printer=printer,
        protocol=SimpleNamespace(kill_bytes=b"M112\n"),
    )
    kill = Kill(wiring)
    striking = threading.Thread(target=kill.strike)
    striking.start()
    assert wire.written.wait(10)
    kill.heard()  # it was on the wire already
    clock.sleep(1.0)
    if says_something:
        kill.heard()
    kill.halted()
    striking.join()
    assert told in kill.words(MotorRunOn(0.634, 4.5))


@pytest.mark.parametrize("in_flight", [1, 2])
def test_each_line_in_flight_has_a_quickstop_behind_the_one_that_stops_the_motors(in_flight):
    """One that is let in afterwards was made on a real board: up to 19 mm, 2 s later.

    The first may take the second with it: a waiting line was made, 1.6 mm of plunger, 2.2 s later.
    """
    printer = load(Printer, "marlin_avr").model_copy(update={"lines_in_flight": in_flight})
    halting = halting_of(printer, b"M112\n", emergency_parser=True)
    assert [data for data, _ in halting.first] == [b"\nM410\n"] * (2 + in_flight)
    waits = [wait_s for _, wait_s in halting.first]
    assert sum(waits[:-2]) < in_flight < sum(waits[:-1])  # a line a second, and one more M410
    assert sum(waits) == pytest.approx({1: 2.8, 2: 3.8}[in_flight])  # docs/link.md


# --- run-on time of motors after a kill: predicted within 20 %, never too short
PRINTER = load(Printer, "marlin_avr").model_copy(update={"emergency_parser": False})
LOOK_S = 0.002


def random_moves(rng: random.Random) -> list[str]:
    """Moves of 5 to 60 mm at 10 to 120 mm/s: the fastest feed is far above the mean."""
    return [
        f"G1 X{rng.uniform(20, 90):.2f} Y{rng.uniform(20, 90):.2f} E{0.05 * k:.3f} "
        f"F{rng.uniform(600, 7200):.0f}"
        for k in range(60)
    ]


def raster(rng: random.Random) -> list[str]:
    feed = rng.uniform(900, 4500)
    return [
        f"G1 X{70 if k % 4 < 2 else 50} Y{50 + k // 2 * 0.3:.2f} F{feed:.0f}" for k in range(60)
    ]


def hops(rng: random.Random) -> list[str]:
    lines = []
    for k in range(15):
        x, y = rng.uniform(20, 80), rng.uniform(20, 90)
        travel, written = f"G0 X{x:.2f} Y{y:.2f} F9000", f"G1 X{x + 8:.2f} E{k * 0.1:.2f} F600"
        lines += ["G1 Z7 F300", travel, "G1 Z5 F300", written]
    return lines


def short_moves(rng: random.Random) -> list[str]:
    x, y, lines = 50.0, 50.0, []
    for k in range(60):
        x, y = x + rng.uniform(-3, 3), y + rng.uniform(-3, 3)
        lines.append(f"G1 X{x:.2f} Y{y:.2f} E{0.02 * k:.3f} F{rng.uniform(600, 3600):.0f}")
    return lines


def killed(lines: list[bytes], progress: JobProgress, taken: SimpleNamespace, rng, clock) -> float:
    """Feed a simulated board, kill it with a line waiting; return how long its motors ran on, s."""
    board = MarlinPrinter(PRINTER)
    board.advance(0.1)
    kill_after, strike, heard = rng.randint(25, 50), math.inf, board.exchange(lines[0] + b"\n")
    while board.now < strike:
        board.advance(LOOK_S)
        heard += board.exchange(b"")
        if b"ok" in heard:
            taken.lines_done += 1
            progress.answered(taken.lines_done, board.now)
            if taken.lines_done == kill_after:
                strike = board.now + rng.uniform(0, 0.3)
            heard = board.exchange(lines[taken.lines_done] + b"\n")
    assert b"halted" in board.exchange(b"M112\n")
    clock.append(board.now)
    board.advance(4.0)
    return float(board.executed().time_end[-1]) - clock[0]


@pytest.mark.parametrize("make", [random_moves, raster, hops, short_moves])
@pytest.mark.parametrize("seed", range(6))
def test_told_time_is_true_within_a_fifth_and_never_too_short(make, seed: int) -> None:
    rng = random.Random(f"{make.__name__} {seed}")
    head = ["G21", "G90", "M82", "M302 P1", "G92 X50 Y50 Z5 E0"]
    lines = [line.encode() for line in [*head, *make(rng)]]
    taken = SimpleNamespace(lines_done=0, line_errors=0)
    wiring = SimpleNamespace(printer=PRINTER, protocol=taken)
    progress = JobProgress(wiring, Job(lines, list(range(1, len(lines) + 1)), "", "a"))
    clock: list[float] = []
    true_s = killed(lines, progress, taken, rng, clock)
    halting = halting_of(PRINTER, b"M112\n", emergency_parser=False)
    found = re.search(r"up to ([\d.]+) s", halting.words(progress.run_on(clock[0]), stopped=False))
    assert found is not None
    assert true_s <= float(found[1]) <= 1.2 * true_s


def test_place_that_nobody_has_told_makes_a_move_long() -> None:
    """Too long is told, never too short."""
    (move,) = planned_moves([b"G1 X5 F600"], 0, 1, Modal(), PRINTER)
    assert move.length_mm >= 1000


def test_places_under_way_are_found_with_each_line_read_about_once(monkeypatch) -> None:
    """A job that never gives Z was once read from its end to its beginning for each place."""
    lines = [b"G1 X%d Y5 E%d F600" % (k % 7, k) for k in range(300)]
    wiring = SimpleNamespace(printer=PRINTER, protocol=SimpleNamespace(lines_done=300))
    progress = JobProgress(wiring, Job(lines, list(range(1, 301)), "", "a"))
    count = 0

    def counted(line: bytes) -> GcodeLine:
        nonlocal count
        count += 1
        return read_sent(line)

    monkeypatch.setattr(coordinates, "read_sent", counted)
    assert progress.places_under_way()[-1] == {"x": 5.0, "y": 5.0, "e": 299.0}
    assert count <= len(lines) + 100
    assert set(progress.heights()) == set()
    assert count <= 2 * len(lines) + 200


# --- controlled stop on Marlin: M410 discards planned moves; the retreat starts there
PRINTER_QUICKSTOP = load(Printer, "generic_marlin")
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
    printer = MarlinPrinter(PRINTER_QUICKSTOP, (50.0, 50.0, 10.0))
    transport = kind(printer, VirtualClock(), np.random.default_rng(0))
    asked: list[float] = []

    def stop_once(status: Status) -> None:
        if status.lines_done > 40 and not asked:
            asked.append(transport.clock.now())
            streamer.stop()

    job = (HEADER + moves).encode()
    streamer = wired(transport, folder, job, PRINTER_QUICKSTOP, on_status=stop_once)
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
    assert "its queued moves weren't executed" in status.message
    assert status.lines_done > 40 > status.lines_executed
    assert "while extruding" not in status.message  # it was told to


@pytest.mark.parametrize("parser", [True, False])
def test_the_needle_stays_in_the_print_for_two_quickstops_at_most(tmp_path, parser):
    """Marlin drops moves for a second behind each: the lift waits for it, though nothing moves."""
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    wire = Stopping(simulated_printer(printer)(printer, (50.0, 50.0, 10.0)), VirtualClock())
    wire.moment, sent = Moment(b"X40 E0.9", 0.5), list[bytes]()
    write = wire.write
    wire.write = lambda data: (sent.append(data), write(data))[1]
    protocol = protocol_for(printer, wire.quiet_s)
    wire.streamer = wired(wire, tmp_path, JOB.encode(), printer, protocol=protocol, retreat=RETREAT)
    status = wire.streamer.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status
    assert b"".join(sent).count(b"M410") == (2 if parser else 1)
    assert_stands(wire, 0.15 if parser else 2.1)


def test_a_stop_whose_position_cant_be_read_ends_with_a_sentence(tmp_path):
    """The job names Y alone, so that nobody knows X."""
    moves = "".join(f"G1 Y{20 + 20 * (k % 2)} F1200\n" for k in range(1, 200))
    status, _, _ = stopped("G92 E0\n" + moves, tmp_path, Unreadable)
    assert status.state is LinkState.STOPPED
    assert "its position can't be read" in status.message
    assert not status.position_known


# --- stop during a wait of the link itself, on the simulated Marlin: motor behaviour
MARLIN = load(Printer, "generic_marlin")
START_HEADER = SIM_HEADER.decode()
JOB = START_HEADER + "".join(f"G1 X{20 + 20 * (k % 2)} E{k / 10:.1f} F1200\n" for k in range(1, 41))
PAUSE_LINE = 25
SLICE_S = 0.005
RETREAT = Retreat(relief_mm=0.3, prime_mm=0.2)


@dataclass(frozen=True)
class Moment:
    """When somebody stops: so long after the link has written a text for the so-manieth time."""

    text: bytes
    after_s: float
    count: int = 1
    in_state: LinkState | None = None


class Stopping(SimTransport):
    """A wire at which a person watches what is written, and stops at a moment."""

    moment: Moment
    streamer: Streamer
    seen = 0
    due_s = np.inf
    asked_s = np.inf

    def write(self, data: bytes) -> None:
        super().write(data)
        state = self.streamer.status.state
        if self.moment.text in data and self.moment.in_state in (None, state):
            self.seen += 1
            if self.seen == self.moment.count:
                self.due_s = self.clock.now() + self.moment.after_s

    def read(self, timeout: float) -> bytes:
        """Let printer and person live through the time, never the printer ahead of the person."""
        end, data = self.clock.now() + timeout, b""
        while not data and self.clock.now() < end and self.clock.now() < self.due_s:
            self.clock.move_to(min(self.clock.now() + SLICE_S, end, self.due_s))
            self.printer.run_to(self.clock.now())
            data = self.printer.take_output()
        if self.clock.now() >= self.due_s:
            self.asked_s, self.due_s = self.clock.now(), np.inf
            self.streamer.stop()
        return data


def stopped_at(
    moment: Moment, folder: Path, printer: Printer = MARLIN, job: str = JOB, reload: bool = False
) -> tuple[Status, Stopping]:
    """Print, pause after some lines, resume at once, and stop at ``moment``."""
    wire = Stopping(simulated_printer(printer)(printer, (50.0, 50.0, 10.0)), VirtualClock())
    wire.moment, asked = moment, list[LinkState]()

    def once(status: Status, state: LinkState) -> bool:
        new = status.state is state and state not in asked
        asked.extend([state] if new else [])
        return new

    def on_status(status: Status) -> None:
        if status.lines_done >= PAUSE_LINE and once(status, LinkState.PRINTING):
            streamer.pause()
        if once(status, LinkState.PAUSED):
            if reload:
                streamer.reload()
            else:
                streamer.resume()
        elif reload and status.waits_for == "syringe" and once(status, LinkState.CHECKING):
            streamer.resume(NewSyringe(plunger_mm=0.0))

    protocol = protocol_for(printer, wire.quiet_s)
    more = {"protocol": protocol, "on_status": on_status, "retreat": RETREAT}
    streamer = wire.streamer = wired(wire, folder, job.encode(), printer, **more)
    return streamer.run(), wire


def after(motion: ExecutedMotion, at_s: float) -> np.ndarray:
    """Which moves were still made after a moment, but for what began before."""
    return motion.time_end > at_s


def assert_stands(wire: Stopping, within_s: float) -> ExecutedMotion:
    """Nothing sideways, nothing downwards and nothing pushed once so much time is over."""
    motion = wire.printer.executed()
    late = after(motion, wire.asked_s + within_s)
    assert np.array_equal(motion.start[late][:, :2], motion.end[late][:, :2])
    assert (motion.end[late][:, 2] >= motion.start[late][:, 2]).all()
    assert (motion.plunger_end[late] <= motion.plunger_start[late] + 1e-9).all()
    return motion


PAUSING = Moment(b"M0400", 1.3)
LOWERING = Moment(b"G1 Z", 0.15, count=4)
PRIMING = Moment(b"G1 E", 0.2, count=2)


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("moment", [PAUSING, LOWERING, PRIMING], ids=["pause", "down", "prime"])
def test_motors_stand_at_once_in_each_wait(tmp_path, moment, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    status, wire = stopped_at(moment, tmp_path, printer)
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status
    motion = assert_stands(wire, 0.15)
    assert motion.end[-1, 2] == pytest.approx(30.0)  # up by 20 mm, from wherever it was


@pytest.mark.parametrize("moment", [PAUSING, LOWERING], ids=["pause", "down"])
def test_the_plunger_is_relieved_once(tmp_path, moment):
    """By the same amount whether the pause had relieved it before or not."""
    _, wire = stopped_at(moment, tmp_path)
    motion = wire.printer.executed()
    most = motion.plunger_end.max()
    assert motion.plunger_end[-1] == pytest.approx(most - RETREAT.relief_mm, abs=0.002)


def test_a_syringe_that_is_changed_keeps_its_plunger(tmp_path):
    moment = Moment(b"G1 Z70", 0.5)
    status, wire = stopped_at(moment, tmp_path, reload=True)
    assert status.state is LinkState.STOPPED
    motion = assert_stands(wire, 5.0)
    moved = np.flatnonzero(motion.plunger_end != motion.plunger_start)
    assert motion.time_end[moved[-1]] < wire.asked_s


def test_a_wait_for_heat_is_ended(tmp_path):
    job = JOB + "M109 S40\n" + "G1 X20 E9 F1200\n"
    status, wire = stopped_at(Moment(b"M109", 2.0), tmp_path, job=job)
    assert status.state is LinkState.STOPPED
    assert wire.clock.now() - wire.asked_s < 15


@pytest.mark.parametrize("parser", [True, False])
def test_a_stop_in_the_last_wait_drops_the_last_moves(tmp_path, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    moment = Moment(b"M0400", 1.3, in_state=LinkState.PRINTING)
    status, wire = stopped_at(moment, tmp_path, printer)
    assert status.state is LinkState.STOPPED, status
    assert_stands(wire, 0.15)
    assert status.lines_done == status.lines_total > status.lines_executed


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("in_flight", [1, 2])
def test_a_line_that_waits_for_room_isnt_made(tmp_path, parser, in_flight):
    printer = MARLIN.model_copy(update={"emergency_parser": parser, "lines_in_flight": in_flight})
    status, wire = stopped_at(Moment(b"G1 X", 0.4, count=20), tmp_path, printer)
    assert status.state is LinkState.STOPPED, status
    assert_stands(wire, 0.15)


def test_a_firmware_without_quickstop_comes_down_no_further_than_the_step_in_hand(tmp_path):
    duet = load(Printer, "makergear_m2_duet2")
    job = JOB.replace("M85 S600\n", "")
    moment = Moment(b"G1 Z", 0.15, count=4)
    status, wire = stopped_at(moment, tmp_path, duet, job)
    assert status.state is LinkState.STOPPED, status
    assert_stands(wire, 0.7)  # 2 mm at 5 mm/s, and its beginning and end


# --- stop during an arc: Marlin continues generating segments after M410
CIRCLES = START_HEADER + "G3 X90 Y50 I20 J0 E0.5 F900\nG3 X50 Y50 I-20 J0 E1.0 F900\n" * 2
MIDDLE, RADIUS_MM = np.array([70.0, 50.0]), 20.0


@pytest.mark.parametrize("parser", [True, False])
@pytest.mark.parametrize("after_s", [0.4, 1.5, 3.0])
def test_a_stop_in_an_arc_never_leaves_the_arc(tmp_path, after_s, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    status, wire = stopped_at(Moment(b"G3 X50", after_s), tmp_path, printer, job=CIRCLES)
    assert (status.state, status.position_known) == (LinkState.STOPPED, True), status
    motion = wire.printer.executed()
    across = np.any(motion.start[:, :2] != motion.end[:, :2], axis=1)
    middles = (motion.start[across, :2] + motion.end[across, :2]) / 2
    away = np.linalg.norm(middles - MIDDLE, axis=1) - RADIUS_MM
    assert np.abs(away).max() < 0.05
    stood = motion.end[across][-1, :2]
    assert np.linalg.norm(stood - [50.0, 50.0]) > 1.0  # the circle isn't made to its end


@pytest.mark.parametrize("parser", [True, False])
def test_nothing_is_begun_behind_the_arc(tmp_path, parser):
    printer = MARLIN.model_copy(update={"emergency_parser": parser})
    job = CIRCLES + "G1 X50 Y20 E1.2\n"
    _, wire = stopped_at(Moment(b"G1 X50", 0.0), tmp_path, printer, job=job)
    assert wire.printer.executed().end[:, 1].min() > 29.9
