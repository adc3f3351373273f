"""Lines that die and come back: when the print goes on, and which standstills are told."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import numpy as np
import pytest

from firmware_profiles import Printer, load
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.ports.serial_port import SerialTransport
from printctl.machine.records.states import LinkState, Status
from sim.devices.board.controller import FaultPlan
from sim.devices.board.printer import SimulatedPrinter
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.families.registry import simulated_printer
from sim.devices.faults import Fault, FaultFile
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.simulated import (
    HEADER,
    PRINTER,
    START,
    gcode,
    printed,
    same_motion,
    wired,
)
from tests.printctl.machine.link.simulated_transport import SimulatedTransport

BEGINS_S = 20.0


class DeadLine(SimulatedTransport):
    """A line that is dead for a time: what is sent meanwhile is lost, or held until its end."""

    def __init__(
        self,
        dead_s: float,
        held: bool,
        down: bool = True,
        up: bool = True,
        printer: SimulatedPrinter | None = None,
    ) -> None:
        super().__init__(printer or MarlinPrinter(PRINTER, START), VirtualClock())
        self.next_line_s = self.lift_s = math.inf
        self.ends_s, self.held, self.down, self.up = BEGINS_S + dead_s, held, down, up
        self._down: list[bytes] = []
        self._up = b""

    @property
    def dead(self) -> bool:
        return BEGINS_S <= self.clock.now() < self.ends_s

    def write(self, data: bytes) -> None:
        if self.dead and self.down:
            self._run_printer()
            self._down += [data] if self.held else []
            return
        self._let_go()
        if b"G1 X" in data and self.clock.now() >= self.ends_s:
            self.next_line_s = min(self.next_line_s, self.clock.now())
        if b"G1 Z" in data and self.clock.now() >= self.ends_s:
            self.lift_s = min(self.lift_s, self.clock.now())
        super().write(data)

    def _let_go(self) -> None:
        waiting, self._down = ([], self._down) if self.dead else (self._down, [])
        for data in waiting:
            super().write(data)

    def read(self, timeout: float) -> bytes:
        self._let_go()
        data = super().read(timeout)
        if self.dead and self.up:
            self._up += data if self.held else b""
            return b""
        data, self._up = self._up + data, b""
        return data


_TOLD = re.compile(
    r"the needle stopped while extruding"
    r"(?: \d times, [0-9.]+ s in total, longest|,) for ([0-9.]+) s"
)
_ALARM = re.compile(r'"t":"alarm"[^\n]*?"text":"(the needle stopped while extruding[^"]*)"')
_PLACE = re.compile(r"line \d+ \(X([\d.]+) Y([\d.]+)")


def stood_s(message: str) -> float:
    """Seconds that a last message tells of; 0 for none."""
    found = _TOLD.search(message)
    return float(found[1]) if found else 0.0


def assert_told_truly(message: str, made: ExecutedMotion) -> None:
    """Compare a last message with the longest time in which no motor moved, and with its place."""
    gaps = made.time_start[1:] - made.time_end[:-1]
    longest = int(gaps.argmax())
    found = _TOLD.search(message)
    if gaps[longest] < 1.0:  # it held moves enough
        assert found is None
        return
    assert found is not None, message
    assert float(found[1]) == pytest.approx(gaps[longest], abs=0.5)
    told = [[float(word) for word in place] for place in _PLACE.findall(message, found.end())]
    assert 1 <= len(told) <= 2
    assert any(np.allclose(place, made.end[longest, :2], atol=0.02) for place in told), message


@pytest.mark.parametrize(("down", "up"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize(("dead_s", "held"), [(5.0, False), (25.0, False), (25.0, True)])
def test_print_goes_on_within_two_seconds_of_the_lines_return(tmp_path, dead_s, held, down, up):
    alone, _ = DeadLine(0.0, False), (tmp_path / "alone").mkdir()
    printed(gcode(400), tmp_path / "alone", alone)
    line = DeadLine(dead_s, held, down, up)
    status, _ = printed(gcode(400), tmp_path, line)
    late_s = line.clock.now() - alone.clock.now()
    assert status.state is LinkState.DONE
    assert late_s < dead_s + 2.0
    assert_told_truly(status.message, line.printer.executed())


@pytest.mark.parametrize(
    ("profile", "header"),
    [
        ("ender5_duet3_replistruder5", b"M302 P1\n"),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n"),
    ],
)
@pytest.mark.parametrize(("down", "up"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize(
    ("dead_s", "held"), [(0.3, False), (5.0, False), (25.0, False), (25.0, True)]
)
def test_print_on_other_boards_goes_on_too(tmp_path, profile, header, dead_s, held, down, up):
    facts = load(Printer, profile)
    job = parse_job(
        header + b"G90\nM82\n" + gcode(300, b"G92 X50 Y50 Z10 E0\n"), "test.gcode", facts
    )

    def made(line: DeadLine) -> ExecutedMotion:
        (folder := tmp_path / str(line.ends_s)).mkdir()
        status = wired(line, folder, job, facts, protocol=protocol_for(facts, 0.05)).run()
        assert status.state is LinkState.DONE
        assert_told_truly(status.message, line.printer.executed())
        return line.printer.executed()

    alone, line = (
        DeadLine(seconds, held, down, up, simulated_printer(facts)(facts, START))
        for seconds in (0.0, dead_s)
    )
    assert same_motion(made(alone), made(line))
    assert line.next_line_s - line.ends_s < 2.0


def assert_each_told(folder: Path, made: ExecutedMotion, least: int) -> None:
    """Compare the alarms with all gaps above 1 s between moves in the ink (Z 10)."""
    gaps = made.time_start[1:] - made.time_end[:-1]
    stood = [k for k in np.flatnonzero(gaps > 1.0) if made.end[k, 2] <= 10.0]
    assert len(stood) >= least
    texts = _ALARM.findall((folder / "journal.log").read_text())
    assert len(texts) == len(stood), texts
    for text, k in zip(texts, stood, strict=True):
        assert stood_s(text) == pytest.approx(gaps[k], abs=0.5)
        told = [[float(word) for word in place] for place in _PLACE.findall(text)]
        assert any(np.allclose(place, made.end[k, :2], atol=0.02) for place in told), text


class Flapping(DeadLine):
    """A line that dies again and again; with ``asked_s`` a pause is asked for."""

    def __init__(
        self,
        windows: tuple[tuple[float, float], ...],
        held: bool,
        down: bool,
        asked_s: float = math.inf,
    ) -> None:
        super().__init__(0.0, held, down)
        self.windows, self.asked_s, self.asked = windows, asked_s, list[Streamer]()

    @property
    def dead(self) -> bool:
        now = self.clock.now() - BEGINS_S
        return any(begin <= now < end for begin, end in self.windows)

    def read(self, timeout: float) -> bytes:
        if self.clock.now() - BEGINS_S > self.asked_s and self.asked:
            self.asked.pop().pause()
        return super().read(timeout)


@pytest.mark.parametrize("gap_s", [0.3, 3.0])
@pytest.mark.parametrize("down", [True, False])
@pytest.mark.parametrize("held", [True, False])
def test_each_of_two_outages_is_told_with_its_place(tmp_path, held, down, gap_s):
    line = Flapping(((0.0, 6.0), (6.0 + gap_s, 16.0)), held, down)
    status, _ = printed(gcode(400), tmp_path, line)
    assert status.state is LinkState.DONE
    assert_each_told(tmp_path, line.printer.executed(), least=2)


@pytest.mark.parametrize("lost", [False, True])
def test_end_of_the_file_with_all_moves_made_is_no_standstill(tmp_path, lost):
    """The line dies when the last line, which lifts the needle, is sent; or it is lost, too."""

    class Late(DeadLine):
        def write(self, data: bytes) -> None:
            if b"G1 Z20" in data and self.ends_s == math.inf:
                self.begins_s, self.ends_s = self.clock.now() + (0.0 if lost else 0.001), 0.0
                self.ends_s = self.begins_s + 12.0
            super().write(data)

        @property
        def dead(self) -> bool:
            return self.begins_s <= self.clock.now() < self.ends_s

    line = Late(math.inf, held=False)
    line.begins_s = math.inf
    status, _ = printed(gcode(60) + b"G1 Z20\n", tmp_path, line)
    assert status.state is LinkState.DONE
    assert bool(stood_s(status.message)) == lost


def test_ink_that_stands_before_the_needle_is_lifted_for_a_pause_is_told(tmp_path):
    """The planner ran nearly empty before, and the answer to the link's own wait was lost."""
    line = Flapping(((0.0, 2.3), (2.697, 8.0)), held=False, down=False, asked_s=2.6)
    status, _ = printed(gcode(400), tmp_path, line, keep=line.asked)
    assert status.state is LinkState.DONE
    assert_each_told(tmp_path, line.printer.executed(), least=1)


@pytest.mark.parametrize("asked_s", [0.8, 6.0, 20.0])
@pytest.mark.parametrize(("down", "up"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("held", [False, True])
def test_needle_is_lifted_within_a_second_of_the_lines_return(tmp_path, held, down, up, asked_s):
    """M410 takes a firmware with emergency parser 2 s, though nothing was left to be dropped."""
    asked: list[Streamer] = []

    class Stopped(DeadLine):
        """Somebody asks for a stop while the line is dead."""

        def read(self, timeout: float) -> bytes:
            if self.dead and self.clock.now() > BEGINS_S + asked_s and asked:
                asked.pop().stop()
            return super().read(timeout)

    line = Stopped(25.0, held, down, up)
    status, _ = printed(gcode(400), tmp_path, line, keep=asked)
    assert status.state is LinkState.STOPPED
    drops = held and down and not up  # a line comes back with the wire: M410 takes 1 s
    assert line.lift_s - line.ends_s < (1.3 if drops else 1.0)
    ends_s = line.printer.executed().time_end
    stood = line.lift_s - ends_s[ends_s < line.ends_s].max()
    assert stood_s(status.message) == pytest.approx(stood, abs=0.5)


def test_time_that_the_moves_in_flight_explain_is_no_standstill(tmp_path):
    moves = [b"G1 X%d E%.3f F600" % (50 + i % 2 * 20, 0.02 * (i + 1)) for i in range(40)]
    line = DeadLine(5.0, held=False)
    status, _ = printed(HEADER + b"\n".join(moves) + b"\n", tmp_path, line)
    assert status.state is LinkState.DONE
    assert status.alarms == 0


@pytest.mark.parametrize("mm", [3.5, 20.0])
def test_board_that_stands_still_is_told(tmp_path, mm):
    moves = [b"G1 X%.1f E%.3f F600" % (50 + i % 2 * mm, mm * 0.001 * (i + 1)) for i in range(60)]
    fault = Fault(fault="stall", line=40, seconds=5.0)
    line = SimulatedTransport(MarlinPrinter(PRINTER, START, faults=(fault,)), VirtualClock())
    status, _ = printed(HEADER + b"\n".join(moves) + b"\n", tmp_path, line)
    assert stood_s(status.message) == pytest.approx(5.0, abs=0.5)
    assert status.alarms == 1


def test_board_that_stands_still_among_rows_is_told_with_the_place_in_the_planner(tmp_path):
    """Each second move is short, as between the rows of a layer: its answer waits for nothing."""
    moves = [
        b"G1 X%.1f Y%.2f E%.4f F1200" % (50 + (i + 1) // 2 % 2 * 3.4, 50 + i // 2 * 0.14, 0.002 * i)
        for i in range(120)
    ]
    fault = Fault(fault="stall", line=90, seconds=5.0)
    line = SimulatedTransport(MarlinPrinter(PRINTER, START, faults=(fault,)), VirtualClock())
    status, _ = printed(HEADER + b"\n".join(moves) + b"\n", tmp_path, line)
    assert stood_s(status.message) == pytest.approx(5.0, abs=0.5)
    last = int(re.findall(r"that of line (\d+)", status.message)[0])
    assert 90 - 2 * PRINTER.planner_blocks < last <= 90 - PRINTER.planner_blocks + 3
    assert status.alarms == 1


def test_print_that_a_silent_line_ends_tells_for_how_long_and_where_its_motors_stand(tmp_path):
    line = DeadLine(math.inf, held=False)
    status, _ = printed(gcode(400), tmp_path, line)
    assert status.state is LinkState.FAILED
    found = re.search(r"motors stopped for ([\d.]+) s (.*?); the needle", status.message)
    assert found is not None, status.message
    made = line.printer.executed()
    stood = line.clock.now() - made.time_end[-1]
    assert float(found[1]) == pytest.approx(stood, abs=0.5)
    told = [[float(word) for word in place] for place in _PLACE.findall(found[2])]
    assert any(np.allclose(place, made.end[-1, :2], atol=0.02) for place in told)
    assert "power" in status.message


def test_bytes_that_another_reader_has_taken_are_no_lost_port(pty):
    master, slave = pty
    wire = SerialTransport(os.ttyname(slave), 115_200)
    poll = wire._readable.poll

    class Robbed:
        """Another program reads first."""

        def poll(self, timeout: float) -> list[tuple[int, int]]:
            found = poll(timeout)
            os.read(slave, 100)
            return found

    wire._readable = Robbed()  # type: ignore[assignment]
    os.write(master, b"ok\n")
    assert wire.read(1.0) == b""
    assert wire.stolen == 1
    wire.close()


# --- planned faults of the simulated printer: each ends a print in its documented state
REPO = Path(__file__).parents[4]
UNKNOWN = "position_unknown"
HOT_HEADER = b"M302 P1\nG90\nM82\nM85 S600\nM140 S37\nM109 S40\nG92 X50 Y50 Z10 E0\n"


def printed_with(data: bytes, folder: Path, faults: dict) -> tuple[Status, SimulatedTransport]:
    file = FaultFile.model_validate(faults)
    printer, clock = MarlinPrinter(PRINTER, START, faults=file.at), VirtualClock()
    transport = SimulatedTransport(printer, clock, file, np.random.default_rng(file.seed))
    return wired(transport, folder, data).run(), transport


def heaters(transport: SimulatedTransport) -> tuple[float, float]:
    machine = transport.printer.machine
    return machine.heat.hotend.target_c, machine.heat.bed.target_c


@pytest.mark.parametrize(
    ("fault", "state", "word"),
    [
        ({"fault": "reset"}, LinkState.POSITION_UNKNOWN, "reset"),
        ({"fault": "kill"}, LinkState.KILLED, "halted itself"),
        ({"fault": "runaway"}, LinkState.KILLED, "Thermal Runaway"),
    ],
)
@pytest.mark.parametrize("moment", [{"line": 100}, {"time_s": 40.0}, {"bytes": 5000}])
def test_faults_of_the_board_end_as_documented_with_heaters_off(
    tmp_path, fault, moment, state, word
):
    status, transport = printed_with(gcode(2000, HOT_HEADER), tmp_path, {"at": [fault | moment]})
    assert (status.state, status.position_known) == (state, False)
    assert word in status.message
    assert "still holds" not in status.message
    assert "stay set" not in status.message
    assert "M112" not in status.message  # nobody has sent it
    assert heaters(transport) == (0, 0)
    assert 0 < status.lines_done < 2000
    known_after = transport.clock.now() - transport.printer.now
    assert abs(known_after) < 0.5


def moments_of(printer: MarlinPrinter, *names: str) -> list[float]:
    """When these methods of the printer are called, on its clock."""
    moments: list[float] = []

    def noting(method):
        def noted(*given: object) -> None:
            moments.append(printer.now)
            method(*given)

        return noted

    for name in names:
        setattr(printer, name, noting(getattr(printer, name)))
    return moments


@pytest.mark.parametrize(
    ("profile", "header", "fault", "states"),
    [
        ("ender5_duet3_replistruder5", b"M302 P1\n", "reset", {"failed", "position_unknown"}),
        ("ender5_duet3_replistruder5", b"M302 P1\n", "kill", {"killed"}),
        ("ender5_duet3_replistruder5", b"M302 P1\n", "runaway", {"killed"}),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n", "reset", {UNKNOWN}),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n", "kill", {"killed"}),
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n", "runaway", {"killed"}),
    ],
)
def test_faults_of_other_boards_end_as_documented_too(tmp_path, profile, header, fault, states):
    facts = load(Printer, profile)
    printer, clock = simulated_printer(facts)(facts, START), VirtualClock()
    printer.plan = FaultPlan([Fault(fault=fault, line=60)])
    transport = SimulatedTransport(printer, clock)
    ended = moments_of(printer, "reset", "kill")
    data = gcode(2000, header + b"G90\nM82\nM140 S37\nM109 S40\nG92 X50 Y50 Z10 E0\n")
    status = wired(transport, tmp_path, data, facts, protocol=protocol_for(facts, 0.05)).run()
    assert status.state in states, status
    assert not status.position_known
    assert clock.now() - ended[-1] < 10.0
    assert heaters(transport) == (0, 0)


def test_endstop_that_is_never_found_ends_as_killed_before_the_first_move(tmp_path):
    fault = {"fault": "endstop_stuck", "time_s": 0, "axis": "x", "stuck": "open"}
    data = gcode(50, HOT_HEADER + b"G28 X\n")
    status, transport = printed_with(data, tmp_path, {"at": [fault]})
    assert status.state is LinkState.KILLED
    assert "Homing Failed" in status.message or "halted" in status.message
    assert heaters(transport) == (0, 0)
    assert status.lines_done < len(HOT_HEADER.splitlines()) + 1
