"""Job line refused by the printer: not counted as done, `recover` starts at it."""

from __future__ import annotations

import pytest

from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.test_families import JOB, facts, streamer_of

REFUSED = 10
BAD = [*JOB[:REFUSED], b"G1 X501", *JOB[REFUSED:]]


class RangedDuet(FakeDuet):
    """It refuses a move outside of its axes."""

    def do(self, command: str) -> str:
        if command == "G1 X501":
            return "Error: G1: outside machine limits\nok\n"
        return super().do(command)


class ColdDuet(RangedDuet):
    """Behind that move it refuses the plunger's as well."""

    def do(self, command: str) -> str:
        if any(line.startswith("G1 X501") for line in self.executed) and " E" in command:
            return "Warning: Tool 0 was not driven because its heater is cold\nok\n"
        if command == "G1 X501":
            self.executed.append(command)
        return super().do(command)


FAKES = {"klipper": FakeKlipper, "reprapfirmware": RangedDuet}


@pytest.mark.parametrize("firmware", FAKES)
def test_a_refused_line_is_told_as_refused_and_not_counted(firmware, tmp_path):
    status = streamer_of(firmware, FAKES[firmware](), tmp_path, BAD).run()
    assert status.state is LinkState.FAILED
    assert f"refused line {REFUSED + 1} of test.gcode" in status.message
    assert (status.lines_done, status.lines_executed, status.file_line) == (REFUSED,) * 3
    history = read_journal(tmp_path / "journal.log")
    assert history.done == REFUSED
    assert history.end["refused"] == REFUSED


def test_the_cause_is_quoted_before_what_it_made_of_the_way_out(tmp_path):
    streamer = streamer_of("reprapfirmware", ColdDuet(), tmp_path, BAD)
    message = streamer.run().message
    assert message.startswith(f"the printer refused line {REFUSED + 1} of test.gcode: 'Error: G1:")
    assert "the way out wasn't made as meant" in message
    assert message.index("outside machine limits") < message.index("Tool 0 was not driven")


@pytest.mark.parametrize("firmware", FAKES)
def test_recovery_begins_at_the_line_that_was_refused(firmware, tmp_path):
    streamer_of(firmware, FAKES[firmware](), tmp_path, BAD).run()
    data = b"\n".join(BAD)
    job = parse_job(data, "test.gcode", facts(firmware))
    history = read_journal(tmp_path / "journal.log")
    plan = plan_recovery(job, data, history, facts(firmware), Retreat())
    assert plan.begin == REFUSED
    assert plan.gcode.endswith(b"\n".join(BAD[REFUSED:]))
    assert any("refused" in step and "G1 X501" in step for step in plan.steps)


def test_the_last_line_refused_is_no_print_that_is_done(tmp_path):
    job = [*JOB, b"G1 X501"]
    status = streamer_of("klipper", FakeKlipper(), tmp_path, job).run()
    assert status.state is LinkState.FAILED
    assert status.lines_done == len(JOB)


class SharedKlipper(FakeKlipper):
    """Another program's move is refused while a line of the job is being taken."""

    def take(self, line: bytes) -> str:
        said = super().take(line)
        if JOB[REFUSED] in line and not self.told:
            self.told = True
            return f"{self.words}\n{said}"
        return said

    told = False
    words = "!! Move out of range: 900.000 0.000 0.000 [0.000]"


def test_a_complaint_about_another_programs_command_doubles_no_line(tmp_path):
    status = streamer_of("klipper", SharedKlipper(), tmp_path, JOB).run()
    assert status.state is LinkState.FAILED
    assert "another program's command was refused" in status.message
    assert status.lines_done == status.lines_executed == REFUSED + 1
    data = b"\n".join(JOB)
    job = parse_job(data, "test.gcode", facts("klipper"))
    history = read_journal(tmp_path / "journal.log")
    assert "refused" not in history.end
    plan = plan_recovery(job, data, history, facts("klipper"), Retreat())
    assert plan.begin == REFUSED + 1


@pytest.mark.parametrize("words", ['!! MCU "mcu" shutdown: Timer too close', "!! Driver wobble"])
def test_a_fault_of_the_printers_own_is_no_other_programs_refusal(words, tmp_path):
    fake = SharedKlipper()
    fake.words = words
    status = streamer_of("klipper", fake, tmp_path, JOB).run()
    assert status.state is LinkState.FAILED
    assert words in status.message
    assert "another program" not in status.message
    assert not any(
        "another program" in text for text in read_journal(tmp_path / "journal.log").alarms
    )
    assert status.lines_done == REFUSED + 1


class StuckAtEnd(FakeKlipper):
    """It refuses to wait for the last moves, and stands elsewhere, or where the job ends."""

    def __init__(self, z: float) -> None:
        super().__init__()
        self.z, self.told = z, False

    def take(self, line: bytes) -> str:
        said = super().take(line)
        if line == b"M400" and JOB[-1].decode() in self.executed[-2:] and not self.told:
            self.told, self.at["Z"] = True, self.z
            return "!! Driver wobble\nok\n"
        return said


@pytest.mark.parametrize("z", [0.5, 3.0])
def test_a_refused_wait_behind_the_last_line_ends_as_failed_with_the_retreat(z, tmp_path):
    fake = StuckAtEnd(z)
    status = streamer_of("klipper", fake, tmp_path).run()
    assert (status.state, status.lines_done) == (LinkState.FAILED, len(JOB))
    assert "Driver wobble" in status.message
    assert "refused line" not in status.message
    assert fake.at["Z"] > z + 1
