"""Watched gauges (force, pressure): queried during a print, ending it above a limit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from pydantic import ValidationError

from firmware_profiles import Printer, WatchedGauge
from gcode.dry_run.run import dry_run
from printctl.checks.preflight.firmware import firmware_checks
from printctl.cli.machine.running_print import waiting_lines
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import read_records
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import FaultFile
from sim.devices.faults import Gauge as SimGauge
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Script, layered, played
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    START,
    foreseen,
    same_motion,
)
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.slower import first_of

# --- watched gauges (force, pressure): queried during a print, ending it above a limit
WATCHED = WatchedGauge(query="M871", regex=r"Force: ([-+.\d]+) N", unit="N", high=12.5, every_s=0.5)
WATCHING = PRINTER.model_copy(update={"watch": (WATCHED,), "extra_commands": ("M871",)})
SAYS = "Force: {value:.2f} N"
DATA_MEASURING = layered(6, 40)
JOB_MEASURING = parse_job(DATA_MEASURING, "test.gcode")


def transport_of(ramp, says=SAYS, clock=None, rng=None, **troubles) -> SimTransport:
    printer = MarlinPrinter(PRINTER, START)
    printer.gauges = {"M871": SimGauge(command="M871", says=says, ramp=ramp)}
    return SimTransport(printer, clock or VirtualClock(), rng, **troubles)


def printed(folder, transport, script=None, printer: Printer = WATCHING, **options) -> Status:
    return played(DATA_MEASURING, folder, transport, script or Script(), printer=printer, **options)


def records(tmp_path, sort: str) -> list[dict]:
    found = read_records(tmp_path / "journal.log")
    return [one for one in found if one is not None and one["t"] == sort]


def assert_moved_as_foreseen(transport: SimTransport) -> None:
    assert same_motion(transport.printer.executed(), foreseen(DATA_MEASURING))


def test_readings_below_the_limit_are_journalled_and_shown_and_change_nothing(tmp_path):
    transport, script = transport_of([[0, 1.0], [100, 11.0]]), Script()
    status = printed(tmp_path, transport, script)
    assert status.state is LinkState.DONE, status
    assert status.alarms == 0
    assert_moved_as_foreseen(transport)
    read = records(tmp_path, "reading")
    values = [one["value"] for one in read]
    assert values == sorted(values)
    assert {(one["query"], one["unit"]) for one in read} == {("M871", "N")}
    took = transport.clock.now()
    assert 0.6 * took / 0.5 < len(read) - 1 <= took / 0.5  # every 0.5 s, between two lines
    assert status.readings == (f"M871: {values[-1]:g} N, maximum 12.5 N",)
    assert f"reads {status.readings[0]}" in waiting_lines(status)
    assert Status.from_dict(status.to_dict()) == status
    assert read_journal(tmp_path / "journal.log").done == len(JOB_MEASURING)


def test_a_reading_above_the_limit_ends_the_print_by_a_controlled_stop(tmp_path):
    transport = transport_of([[0, 1.0], [3, 1.0], [6, 20.0]])
    status = printed(tmp_path, transport, retreat=Retreat(relief_mm=0.3, lift_mm=15))
    assert (status.state, status.position_known) == (LinkState.FAILED, True)
    assert "N, its limit is 12.5 N" in status.message
    assert 0 < status.lines_done < len(JOB_MEASURING)
    last = records(tmp_path, "reading")[-2:]
    assert all(one["value"] > 12.5 for one in last)
    crossed = 3 + 3 * 11.5 / 19
    motion = transport.printer.executed()
    assert motion.time_end[-1] > crossed
    assert motion.end[-1, 2] - motion.start[-1, 2] == pytest.approx(15)
    relief = motion.plunger_end[-2] - motion.plunger_start[-2]
    assert relief == pytest.approx(-0.3, abs=2e-3)
    written = np.flatnonzero(motion.plunger_end > motion.plunger_start)
    held = 18 * 0.15  # what planner and queue held, s
    assert motion.time_end[written[-1]] < crossed + 0.5 + held
    assert any("limit" in text for text in read_journal(tmp_path / "journal.log").alarms)


def answering_oddly(odd: Callable[[int], str]) -> SimTransport:
    """A printer whose answer of some number is another than its gauge's, if ``odd`` gives one."""
    transport = transport_of([[0, 1.0], [100, 11.0]])
    gauge, answers = transport.printer.gauges["M871"], iter(range(10**6))

    class Odd(SimGauge):
        def at(self, time_s: float) -> str:
            return odd(next(answers)) or gauge.at(time_s)

    transport.printer.gauges = {"M871": Odd(**gauge.model_dump())}
    return transport


def test_one_wrong_answer_above_the_limit_ends_nothing(tmp_path):
    transport = answering_oddly(lambda number: "Force: 91.00 N" * (number == 4))
    status = printed(tmp_path, transport)
    assert status.state is LinkState.DONE, status
    assert [one["value"] > 12.5 for one in records(tmp_path, "reading")].count(True) == 1
    assert_moved_as_foreseen(transport)


def test_answers_that_can_t_be_read_are_one_alarm(tmp_path):
    status = printed(tmp_path, answering_oddly(lambda number: "Force: none" * (number > 2)))
    assert status.state is LinkState.DONE, status
    (alarm,) = records(tmp_path, "alarm")
    assert alarm["text"] == "3 consecutive replies to M871 can't be read"


@pytest.mark.parametrize(
    ("ramp", "says", "words"),
    [
        ([[0, 12.5]], SAYS, "at rest, before the first line"),
        ([[0, 40.0]], SAYS, "reads 40 N, its limit is 12.5 N"),
        ([[0, 1.0]], "no sensor", "gets no reply that matches its regex"),
        ([[0, 1.0]], "Force: . N", "gets no reply that matches its regex"),
    ],
)
def test_before_the_first_line_a_reading_must_be_there_and_below(tmp_path, ramp, says, words):
    transport = transport_of(ramp, says)
    status = printed(tmp_path, transport)
    assert (status.state, status.lines_done) == (LinkState.FAILED, 0)
    assert status.error == "HandshakeError"
    assert words in status.message
    assert len(transport.printer.executed()) == 0


@pytest.mark.parametrize("seed", first_of(range(8), 3))
def test_a_host_that_dies_among_its_questions_goes_on_exactly(tmp_path, seed):
    rng, clock = np.random.default_rng(seed), VirtualClock()
    transport = transport_of([[0, 1.0]], clock=clock)
    transport.die_at(int(rng.integers(20, 200)), float(rng.random()))
    often = WATCHED.model_copy(update={"every_s": 0.25})
    printer = WATCHING.model_copy(update={"watch": (often,)})
    with pytest.raises(HostDiedError):
        printed(tmp_path, transport, printer=printer)
    again = SimTransport(transport.printer, clock)
    history = read_journal(tmp_path / "journal.log")
    status = printed(tmp_path, again, printer=printer, history=history)
    assert status.state is LinkState.DONE, status
    expected, at = foreseen(DATA_MEASURING).end, 0
    for end in again.printer.executed().end:
        at += at < len(expected) and np.array_equal(end, expected[at])
    assert at == len(expected)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"regex": "Force"}, "0 groups"),
        ({"regex": "(a)(b)"}, "2 groups"),
        ({"regex": "((("}, "is none"),
        ({"query": "G1 Z0"}, "query"),
        ({"query": "M112"}, "stops or renumbers"),
        ({"high": float("inf")}, "finite"),
        ({"every_s": 0.01}, "greater than"),
        ({"low": 1}, "low"),
    ],
)
def test_a_watch_that_can_t_be_is_refused(changes, says):
    with pytest.raises(ValidationError, match=says):
        WatchedGauge.model_validate(WATCHED.model_dump() | changes)


def test_a_question_that_the_firmware_doesn_t_know_is_refused_beforehand():
    run = dry_run(DATA_MEASURING, PRINTER, START)
    strange = WATCHING.model_copy(update={"extra_commands": ()})
    for printer, passed in ((WATCHING, True), (strange, False)):
        checks = {check.place: check for check in firmware_checks(run, printer)}
        assert checks[f"{printer.name}: watch"].passed == passed
        assert checks[f"{printer.name}: watch"].refuses != passed


def test_a_fault_file_s_gauge_is_a_ramp(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(
        "gauges:\n  - {command: M871, says: 'Force: {value:.1f} N', ramp: [[10, 1], [20, 2]]}\n"
    )
    (gauge,) = FaultFile.load(path).gauges
    assert [gauge.at(time) for time in (0, 15, 99)] == [
        "Force: 1.0 N", "Force: 1.5 N", "Force: 2.0 N"]  # fmt: skip
    for wrong in ({"says": "{force}"}, {"ramp": [[2, 1], [1, 1]]}, {"command": "G1"}):
        with pytest.raises(ValidationError):
            FaultFile.model_validate({"gauges": [gauge.model_dump() | wrong]})
