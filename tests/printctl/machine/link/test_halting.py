"""Run-on time of motors after a kill: within 20 % of a real Marlin's."""

from __future__ import annotations

import math
import random
import re
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.machine.link import modal
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.halting import halting_of
from printctl.machine.link.job import Job
from printctl.machine.link.kill import Kill
from printctl.machine.link.modal import Modal
from printctl.machine.link.motor_run_on import MotorRunOn
from printctl.machine.link.planned_moves import planned_moves
from printctl.machine.link.progress import JobProgress
from printctl.machine.link.states import LinkState, Status
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.reading import GcodeLine, read_sent
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import wired


@pytest.mark.parametrize(
    ("feed", "real_s"), [(600, 0.638), (3000, 0.715), (6000, 0.843), (12000, 1.27)]
)
def test_message_tells_the_time_that_was_measured(feed: int, real_s: float) -> None:
    """X and Y alike, 80 steps/mm (2026-11-22, ATmega2560 under simavr)."""
    printer = load(Printer, "marlin_avr")
    halting = halting_of(printer, b"M112\n", emergency_parser=False)
    lines = [b"G92 X0 Y0 Z1", b"G1 X300 Y300 F%d" % feed, b"G1 X0 Y0"]
    told = halting.told(progress_of(lines, 2, printer).run_on(0.0), stopped=False)
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

    def write_urgent(self, data: bytes) -> None:
        self.written.set()


@pytest.mark.parametrize(
    ("parser", "expected"), [(True, {"M410": 0.25, "M112": 1800.75}), (False, {"M112": 0.25})]
)
def test_each_command_of_a_halt_is_told_with_its_own_time(monkeypatch, parser, expected):
    """A write takes 0.25 ms; the printer answers 40 ms after M112."""
    clock, printer = VirtualClock(), load(Printer, "marlin_avr")

    def write_urgent(data: bytes) -> None:
        clock.sleep(0.25e-3)
        if b"M112" in data:
            kill.halted()

    def wait(seconds: float) -> bool:
        clock.sleep(0.04 if kill._halted.is_set() else seconds)
        return kill._halted.is_set()

    kill = Kill(
        SimpleNamespace(
            transport=SimpleNamespace(write_urgent=write_urgent),
            clock=clock,
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
    later = re.search(r"said (\d+) ms later", words)
    assert later is not None
    assert int(later[1]) == 40


@pytest.mark.parametrize(
    ("says_something", "told"),
    [(True, "stopped before that, by M410"), (False, "may have run on for up to 0.6")],
)
def test_only_a_board_that_lived_between_has_obeyed_the_quickstop(says_something, told):
    """One that stood still finds M410 and M112 together, and looks at M112 first."""
    wire, clock, printer = Wire(), VirtualClock(), load(Printer, "marlin_avr")
    wiring = SimpleNamespace(
        transport=wire, clock=clock, printer=printer, protocol=SimpleNamespace(kill_bytes=b"M112\n")
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
    """One that is let in afterwards was made on a real board: up to 19 mm, 2 s later."""
    printer = load(Printer, "marlin_avr").model_copy(update={"lines_in_flight": in_flight})
    halting = halting_of(printer, b"M112\n", emergency_parser=True)
    assert [data for data, _ in halting.first] == [b"\nM410\n"] * (1 + in_flight)
    waits = [wait_s for _, wait_s in halting.first]
    assert sum(waits[:-1]) < in_flight < sum(waits)  # a line a second; M112 behind the last


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
    found = re.search(r"up to ([\d.]+) s", halting.told(progress.run_on(clock[0]), stopped=False))
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

    monkeypatch.setattr(modal, "read_sent", counted)
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
    assert "what it held ahead wasn't made" in status.message
    assert status.lines_done > 40 > status.lines_executed


def test_a_stop_whose_position_cant_be_read_ends_with_a_sentence(tmp_path):
    """The job names Y alone, so that nobody knows X."""
    moves = "".join(f"G1 Y{20 + 20 * (k % 2)} F1200\n" for k in range(1, 200))
    status, _, _ = stopped("G92 E0\n" + moves, tmp_path, Unreadable)
    assert status.state is LinkState.STOPPED
    assert "where it stands can't be read" in status.message
    assert not status.position_known
