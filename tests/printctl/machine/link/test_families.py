"""Prints on fakes of Klipper and RepRapFirmware, in virtual time."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from threading import Thread

import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import Halting
from firmware_profiles.families.timing import MAX_REFUSALS
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.prints.recovery import plan_recovery
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.fake_marlin import zigzag
from tests.printctl.machine.link.jobs import parse_job, with_codes
from tests.printctl.machine.link.protocols import made_protocol
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.simulated import wired

FAKES = {"reprapfirmware": FakeDuet, "klipper": FakeKlipper}
JOB = [b"G90", b"M82", b"G92 E0", b"G1 Z0.5 F300", *zigzag(40)]


def facts(firmware: str) -> Printer:
    changes = {"firmware": firmware, "resets_on_connect": False}
    own = with_codes(load(Printer, "generic_marlin"), "G999", "M42")
    return own.model_copy(update=changes)


def streamer_of(firmware: str, fake, folder, job=JOB, answer=None) -> Streamer:
    transport = ScriptedTransport(answer or fake.receive, VirtualClock())
    protocol, lines = made_protocol(firmware), b"\n".join(job)
    return wired(transport, folder, lines, facts(firmware), protocol=protocol)


def after_handshake(executed: list[str]) -> list[str]:
    ours = {line.decode() for line in JOB}
    begin = len(executed) - 1 - executed[::-1].index("G90")
    return [line for line in executed[begin:] if line in ours]


@pytest.mark.parametrize("firmware", FAKES)
def test_family_prints_a_whole_job(firmware, tmp_path):
    fake = FAKES[firmware]()
    status = streamer_of(firmware, fake, tmp_path).run()
    assert status.state is LinkState.DONE, status
    assert after_handshake(fake.executed) == [line.decode() for line in JOB]


@pytest.mark.parametrize("firmware", FAKES)
def test_other_firmware_than_the_profile_says_is_refused(firmware, tmp_path):
    other = FAKES["klipper" if firmware != "klipper" else "reprapfirmware"]()
    status = streamer_of(firmware, other, tmp_path).run()
    assert status.state is LinkState.FAILED
    assert status.lines_done == 0


@pytest.mark.parametrize("firmware", FAKES)
def test_command_that_the_firmware_refuses_ends_in_a_controlled_stop(firmware, tmp_path):
    fake = FAKES[firmware]()
    status = streamer_of(firmware, fake, tmp_path, [*JOB[:10], b"G999", *JOB[10:]]).run()
    assert status.state is LinkState.FAILED
    assert "G999" in status.message
    # the position proves that M400 was answered (Klipper's board is asked as well), and the lift
    assert [one for one in fake.executed if one != "M119"][-3:] == ["M400", "M114", "M114"]


class GoneBoard(FakeKlipper):
    """Its micro-controller is gone: the host program notices where it must be asked."""

    def take(self, line: bytes) -> str:
        if line.strip() == b"M119" and any(text.startswith("G1 X41") for text in self.executed):
            return "// Klipper state: Shutdown\n!! Lost communication with MCU 'mcu'\nok\n"
        return super().take(line)


def test_klipper_isnt_done_before_its_board_has_answered(tmp_path):
    fake = GoneBoard()
    status = streamer_of("klipper", fake, tmp_path).run()
    assert status.lines_done == len(JOB)
    assert status.state is LinkState.KILLED
    assert not status.position_known
    assert status.lines_executed == 0


class StuckKlipper(FakeKlipper):
    """It refuses to lift the needle."""

    def take(self, line: bytes) -> str:
        if line.startswith(b"G0 Z") or (line.startswith(b"G1 Z") and line not in JOB):
            return "!! Must home axis first: 0.500 0.000 0.000 [0.000]\nok\n"
        return super().take(line)


def test_position_isnt_known_after_a_way_out_that_the_printer_refused(tmp_path):
    job = [*JOB[:10], b"G1 X501", *JOB[10:]]
    status = streamer_of("klipper", StuckKlipper(), tmp_path, job).run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert "the retreat didn't run as planned" in status.message
    assert "Must home axis first" in status.message
    assert "the needle position is unknown" in status.message
    assert read_journal(tmp_path / "journal.log").end["position_known"] is False


@pytest.mark.parametrize("firmware", FAKES)
def test_kill_halts_each_family(firmware, tmp_path):
    fake = FAKES[firmware]()
    streamer = streamer_of(firmware, fake, tmp_path)
    protocol = streamer.wiring.protocol
    assert b"M112" in protocol.kill_bytes
    events = protocol.feed(fake.receive(protocol.kill_bytes), 0.0)
    assert fake.halted
    if firmware == "klipper":  # it is asked why
        assert events == [Halting("// Klipper state: Shutdown")]
        events = protocol.tick(protocol.deadline)
    assert type(events[0]).__name__ == "FirmwareHalted"


@pytest.mark.parametrize("firmware", FAKES)
def test_family_that_forgets_lines_isnt_gone_on_with(firmware, tmp_path):
    fake = FAKES[firmware]()
    streamer_of(firmware, fake, tmp_path).run()
    before = list(fake.executed)
    history = read_journal(tmp_path / "journal.log")
    status = streamer_of(firmware, fake, tmp_path).run(history)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "can't report its last accepted line" in status.message
    assert fake.executed == before


class ForgetfulDuet(FakeDuet):
    """It is reset at a line without a word, and stands somewhere then."""

    def __init__(self, at: float) -> None:
        super().__init__()
        self.stands = at

    def do(self, command: str) -> str:
        if command == JOB[20].decode() and self.stands is not None:
            self.at = dict.fromkeys("XYZE", self.stands)
            self.stands = None
            return ""
        return super().do(command)


@pytest.mark.parametrize(("at", "state"), [(0.0, "position_unknown"), (7.0, "failed")])
def test_duet_that_was_reset_without_a_word_is_found_out_by_where_it_stands(tmp_path, at, state):
    fake = ForgetfulDuet(at)
    streamer = streamer_of("reprapfirmware", fake, tmp_path)
    status = streamer.run()
    assert (status.state, status.position_known) == (state, False)
    assert status.lines_done == 20
    assert streamer.wiring.clock.now() < 10
    assert after_handshake(fake.executed) == [line.decode() for line in JOB[:20]]


@pytest.mark.parametrize("line", [b"M200 D0", b"M220 S100", b"M42 P4 S0", b"M85 S600"])
def test_duet_whose_ok_to_a_setting_was_lost_is_told_it_again(tmp_path, line):
    fake, lost = FakeDuet(), []

    def answer(data: bytes) -> bytes:
        said = fake.receive(data)
        if b" %b*" % line in data and not lost:
            lost.append(said)
            return b""
        return said

    job = [*JOB[:3], line, *JOB[3:]]
    status = streamer_of("reprapfirmware", fake, tmp_path, job, answer).run()
    assert status.state is LinkState.DONE, status
    assert lost
    assert fake.executed.count(line.decode()) == 2


def test_a_line_that_a_duet_never_takes_ends_the_print(tmp_path):
    fake = FakeDuet()

    def answer(data: bytes) -> bytes:
        return b"" if b" %b*" % JOB[20] in data else fake.receive(data)

    status = streamer_of("reprapfirmware", fake, tmp_path, JOB, answer).run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert f"in {MAX_REFUSALS} attempts" in status.message
    assert repr(JOB[20].decode()) in status.message
    assert status.lines_done == 20


class CountingDuet(FakeDuet):
    """It tells its motors' steps, which stand ``astray_mm`` beside the place it tells in Y."""

    def __init__(self, astray_mm: float, axes: str) -> None:
        super().__init__()
        self.astray_mm, self.axes = astray_mm, axes

    def do(self, command: str) -> str:
        if command == "M669":
            return f"Kinematics is {self.axes}, no segmentation\nok\n"
        said = super().do(command)
        if command != "M114":
            return said
        x, y, z = (self.at[axis] for axis in "XYZ")
        steps = f"{round(80 * x)} {round(80 * (y - self.astray_mm))} {round(400 * (z + 0.1))} 0"
        machine = f"{x:.3f} {y:.3f} {z:.3f} Bed comp 0.100"
        return f"{self.where} E0:0.0 Count {steps} Machine {machine}\nok\n"


@pytest.mark.parametrize(
    ("astray_mm", "axes", "state", "words"),
    [
        (0.0, "Cartesian", LinkState.DONE, "lines done"),
        (0.1, "Cartesian", LinkState.POSITION_UNKNOWN, "its motor steps correspond"),
        (0.1, "CoreXY", LinkState.DONE, "without motor steps"),
    ],
)
def test_end_compares_the_motors_steps_of_a_duet(tmp_path, astray_mm, axes, state, words):
    status = streamer_of("reprapfirmware", CountingDuet(astray_mm, axes), tmp_path).run()
    assert status.state is state
    assert words in status.message
    assert "aren't" in words or "aren't" not in status.message


class TellingKlipper(FakeKlipper):
    """It answers GET_POSITION; its motors' Z may not be made."""

    def __init__(self, rows: str, short_mm: float) -> None:
        super().__init__()
        self.rows, self.short_mm = rows, short_mm

    def take(self, line: bytes) -> str:
        if line.strip() != b"GET_POSITION":
            return super().take(line)
        at, made = self.where, dict(self.at)
        made["Z"] -= self.short_mm if JOB[-1].decode() in self.executed else 0.0
        per_mm = {"X": 80.0, "Y": 80.0, "Z": 400.0}
        steps = " ".join(f"stepper_{a.lower()}:{made[a] * n + 77:.0f}" for a, n in per_mm.items())
        motors = " ".join(f"stepper_{a.lower()}:{made[a]:.6f}" for a in per_mm)
        kinematic = " ".join(f"{a}:{made[a]:.6f}" for a in per_mm)
        told = {
            "mcu": steps,
            "stepper": motors,
            "kinematic": kinematic,
            "toolhead": at,
            "gcode": at,
            "gcode base": "X:0.0 Y:0.0 Z:0.0 E:0.0",
        }
        return "".join(f"// {row}: {told[row]}\n" for row in self.rows.split(",")) + "ok\n"


@pytest.mark.parametrize(
    "rows", ["mcu,stepper,kinematic,toolhead,gcode,gcode base", "mcu,stepper,gcode,gcode base"]
)
@pytest.mark.parametrize(
    ("short_mm", "state"), [(0.0, LinkState.DONE), (0.4, LinkState.POSITION_UNKNOWN)]
)
def test_klippers_motors_must_stand_where_the_job_ends(rows, short_mm, state, tmp_path):
    status = streamer_of("klipper", TellingKlipper(rows, short_mm), tmp_path).run()
    assert status.state is state
    assert ("0.10 mm" in status.message) == ("0.50 mm" in status.message) == bool(short_mm)


def test_a_fault_of_the_printer_beside_a_line_that_was_made_counts_the_line(tmp_path):
    class Hot(FakeDuet):
        def do(self, command: str) -> str:
            said = super().do(command)
            fault = "Heater 1 fault: temperature excursion exceeded 15.0C\n"
            return f"{fault}{said}" if command == JOB[20].decode() else said

    status = streamer_of("reprapfirmware", Hot(), tmp_path).run()
    assert status.state is LinkState.FAILED
    assert status.lines_executed == status.lines_done == 21
    assert read_journal(tmp_path / "journal.log").stood["certain"]


@pytest.mark.parametrize("stuck_at", [0, 40])
def test_a_duet_whose_motors_stand_is_never_done(tmp_path, stuck_at):
    """It acknowledges, its M114's name moves on, and it doesn't answer M669."""
    fake = FakeDuet()
    fake.stuck_at = stuck_at
    status = streamer_of("reprapfirmware", fake, tmp_path).run()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert status.lines_done == len(JOB)


# --- job line refused by the printer: not counted as done, `recover` starts at it
REFUSED = 10
BAD = [*JOB[:REFUSED], b"G1 X501", *JOB[REFUSED:]]


class RangedDuet(FakeDuet):
    """It refuses a move outside of its axes."""

    def do(self, command: str) -> str:
        if command == "G1 X501":
            return "Error: G1: outside machine limits\nok\n"
        return super().do(command)


RANGED = {"klipper": FakeKlipper, "reprapfirmware": RangedDuet}


@pytest.mark.parametrize("firmware", RANGED)
def test_a_refused_line_is_told_as_refused_and_not_counted(firmware, tmp_path):
    status = streamer_of(firmware, RANGED[firmware](), tmp_path, BAD).run()
    assert status.state is LinkState.FAILED
    assert f"rejected line {REFUSED + 1} of test.gcode" in status.message
    assert (status.lines_done, status.lines_executed, status.file_line) == (REFUSED,) * 3
    history = read_journal(tmp_path / "journal.log")
    assert history.done == REFUSED
    assert history.end["refused"] == REFUSED


@pytest.mark.parametrize("firmware", RANGED)
def test_recovery_begins_at_the_line_that_was_refused(firmware, tmp_path):
    streamer_of(firmware, RANGED[firmware](), tmp_path, BAD).run()
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
    assert "another program's command was rejected" in status.message
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
    assert "rejected line" not in status.message
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


@pytest.mark.parametrize("firmware", FAKES)
def test_the_error_ends_the_print_by_its_own_words(firmware, tmp_path):
    status = streamer_of(firmware, refusing(FAKES[firmware], SAID[firmware]), tmp_path).run()
    assert (status.state, status.position_known) == (LinkState.FAILED, False)
    assert SAID[firmware] in status.message
    assert status.message.index(SAID[firmware]) < status.message.index("no valid reply")


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
    return Streamer(wiring, streamer.job), wire, fake


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
    assert "emergency stop by the user; the firmware had halted itself before" in status.message
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
    assert "emergency stop by the user" in status.message
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
    assert "emergency stop by the user; M112 left the host" in status.message
