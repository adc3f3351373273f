"""Run-on time of motors after a kill: within 20 % of a real Marlin's."""

from __future__ import annotations

import re
import threading
from types import SimpleNamespace

import pytest

from firmware_profiles import Printer, load
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.halting import halting_of
from printctl.machine.link.job import Job
from printctl.machine.link.kill import Kill
from printctl.machine.link.motor_run_on import MotorRunOn
from printctl.machine.link.progress import JobProgress


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
