"""Job line refused by the printer: not counted as done, `recover` starts at it."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from threading import Thread

import pytest

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState
from printctl.machine.link.streamer import Streamer
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.test_families import JOB, facts, streamer_of

REFUSED = 10
BAD = [*JOB[:REFUSED], b"G1 X501", *JOB[REFUSED:]]


class RangedDuet(FakeDuet):
    """It refuses a move outside of its axes."""

    def do(self, command: str) -> str:
        if command == "G1 X501":
            return "Error: G1: outside machine limits\nok\n"
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


# --- printer that answers everything after an error with another error: the print ends
SAID = {"klipper": "!! Lost communication with MCU", "reprapfirmware": "Error: Driver 3 failed"}


def refusing(base, words: str):
    class Refusing(base):
        """It takes twenty lines of the job."""

        failed = False

        def take(self, line: bytes) -> str:
            self.failed |= JOB[20] in line
            return f"{words}\nok\n" if self.failed else super().take(line)

    return Refusing()


BASES = {"klipper": FakeKlipper, "reprapfirmware": FakeDuet}


@pytest.mark.parametrize("firmware", BASES)
def test_the_error_ends_the_print_by_its_own_words(firmware, tmp_path):
    status = streamer_of(firmware, refusing(BASES[firmware], SAID[firmware]), tmp_path).run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert SAID[firmware] in status.message
    assert status.message.index(SAID[firmware]) < status.message.index("no usable answer")


# --- klipper's shutdown reason, queried after the shutdown
WHY = b"// MCU 'mcu' shutdown: Timer too close\n// This often indicates the host is overloaded.\n"


def in_a_job() -> KlipperProtocol:
    machine = KlipperProtocol()
    machine.load([b"G1 X1", b"G1 X2", b"G1 X3"], 0, 0)
    machine.held = False
    machine.go(0.0)
    assert machine.take_output() == b"G1 X1\n"
    return machine


def test_the_reason_of_a_shutdown_is_asked_and_told() -> None:
    machine = in_a_job()
    events = machine.feed(b"// Klipper state: Shutdown\n", 1.0)
    assert events == [said.Halting("// Klipper state: Shutdown")]
    assert machine.take_output() == b"STATUS\n"
    events = machine.feed(b"ok\n" + WHY + b"!! MCU 'mcu' shutdown: Timer too close\nok\n", 1.1)
    assert events == [
        said.FirmwareHalted("// Klipper state: Shutdown: MCU 'mcu' shutdown: Timer too close")
    ]
    assert machine.take_output() == b""


class ShutDown(FakeKlipper):
    """It shuts down at a line, and tells the reason late or never."""

    def take(self, line: bytes) -> str:
        if line == JOB[20]:
            self.halted = True
            return "// Klipper state: Shutdown\nok\n"
        return "" if line == b"STATUS" else super().take(line)


class LateWire(ScriptedTransport):
    """The printer says something a while after it was asked for its state."""

    tells_s = math.inf
    at_status = staticmethod(lambda: None)

    def write(self, data: bytes) -> None:
        super().write(data)
        if data == b"STATUS\n":
            self.tells_s = self.clock.now() + 1.5
            self.at_status()

    def read(self, timeout: float) -> bytes:
        data = super().read(timeout)
        if self.clock.now() < self.tells_s:
            return data
        self.tells_s = math.inf
        return data + b"!! MCU 'mcu' shutdown: Timer too close\n"


def shutting_down(folder):
    fake, clock = ShutDown(), VirtualClock()
    streamer = streamer_of("klipper", fake, folder)
    wire = LateWire(fake.receive, clock)
    wiring = replace(streamer.wiring, transport=wire, clock=clock)
    return Streamer(wiring, streamer.parts.channel.logbook.progress.job), wire, fake


def test_a_printer_that_has_shut_down_before_is_known_by_its_first_answer() -> None:
    machine = KlipperProtocol()
    machine.renumber(0.0)
    assert machine.take_output() == b"M105\n"
    answer = b"// Shutdown due to webhooks request\n// Printer is shutdown\n"
    events = machine.feed(answer + b"!! Shutdown due to webhooks request\nok\n", 0.1)
    assert events[-1] == said.FirmwareHalted(
        "// Printer is shutdown: Shutdown due to webhooks request"
    )


def test_a_kill_before_the_question_has_left_leaves_the_reason_to_be_told(tmp_path) -> None:
    streamer, wire, _ = shutting_down(tmp_path)
    journal = streamer.wiring.journal
    add = journal.add

    def killing(sort: str, **values) -> None:
        add(sort, **values)
        if "halted itself" in values.get("text", ""):
            streamer.kill()

    journal.add = killing
    status = streamer.run()
    assert b"STATUS\n" in wire.written
    assert status.state is LinkState.KILLED
    assert "killed by the user; the firmware had halted itself before" in status.message
    assert "MCU 'mcu' shutdown: Timer too close" in status.message


def test_the_message_quotes_a_reason_that_comes_late(tmp_path) -> None:
    streamer, _, fake = shutting_down(tmp_path)
    status = streamer.run()
    assert (status.state, status.position_known) == (LinkState.KILLED, False)
    assert "MCU 'mcu' shutdown: Timer too close" in status.message
    assert JOB[21].decode() not in fake.executed


def test_a_kill_leaves_while_the_reason_is_waited_for_and_ends_the_print(tmp_path) -> None:
    streamer, wire, _ = shutting_down(tmp_path)
    wire.at_status = streamer.kill
    status = streamer.run()
    assert status.state is LinkState.KILLED
    assert "killed by the user" in status.message
    assert "NOT confirmed" not in status.message
    assert wire.written[-1] == streamer.wiring.protocol.kill_bytes


def test_a_kill_is_confirmed_by_the_word_shutdown_alone(tmp_path) -> None:
    fake = FakeKlipper()
    streamer = streamer_of("klipper", fake, tmp_path)
    wire, kill_bytes = streamer.wiring.transport, streamer.wiring.protocol.kill_bytes
    write, another = wire.write, Thread(target=streamer.kill)

    def killing(data: bytes) -> None:
        write(data)
        if data == JOB[20] + b"\n":
            another.start()
            while kill_bytes not in wire.written:
                time.sleep(0.001)

    wire.write = killing
    status = streamer.run()
    another.join()
    assert status.state is LinkState.KILLED
    assert "killed by the user; M112 left the host" in status.message
