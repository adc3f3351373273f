"""Streamer against a fake Marlin, in virtual time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_profiles.families.link_protocol import MAX_REFUSALS
from printctl.machine.control import halting
from printctl.machine.control.streamer import Streamer
from printctl.machine.errors import PortLost, Refused
from printctl.machine.job.job import Job
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Following, Script, layered, played
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.simulated import wired


def job_of(lines: list[bytes]) -> Job:
    return parse_job(b"\n".join(lines), "test.gcode")


def streamer_of(
    job: Job,
    transport: FakeTransport | ScriptedTransport,
    path: Path,
    on_status: Callable[[Status], None] | None = None,
    **wiring: Any,
) -> Streamer:
    """A streamer; without ``on_status`` each pause is resumed at once."""

    def go_on(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            streamer.resume()

    streamer = wired(transport, path, job, on_status=on_status or go_on, **wiring)
    return streamer


def test_silent_printer_is_a_handshake_error_within_its_time_limit(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    printer.mute = True
    status = streamer_of(job_of(zigzag(3)), FakeTransport(printer, clock), tmp_path).run()
    assert status.state is LinkState.FAILED
    assert status.error == "HandshakeError"
    assert "no firmware answers at fake" in status.message
    assert "baud rate (profile: 115200)" in status.message
    assert clock.now() < 30


def test_printer_whose_steps_differ_from_the_profile_is_refused(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    printer.steps = "  M92 X80.00 Y80.00 Z400.00 E500.00"
    status = streamer_of(job_of(zigzag(3)), FakeTransport(printer, clock), tmp_path).run()
    assert status.error == "HandshakeError"
    assert "E makes 500 steps/mm in the firmware, 6400 in the profile" in status.message
    assert "G1" not in " ".join(printer.executed)


def test_printer_that_falls_silent_fails_at_its_limit_and_alarms_long_before(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    transport = FakeTransport(printer, clock)
    silent_from: list[float] = []

    class Muting(list):
        def append(self, status: Status) -> None:
            if status.lines_done > 50 and not silent_from:
                printer.mute = True
                silent_from.append(clock.now())

    status = streamer_of(job_of(zigzag(3000)), transport, tmp_path, Muting().append).run()
    assert status.state is LinkState.FAILED
    assert not status.position_known
    assert "may or may not have been taken" in status.message
    assert 60 < clock.now() - silent_from[0] < 75
    alarms = read_journal(tmp_path / "journal.log").alarms
    assert any("no usable answer for" in text and "--silent-limit" in text for text in alarms)


def test_many_line_errors_pause_the_print(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    transport = FakeTransport(printer, clock, np.random.default_rng(3), noise=0.004)
    seen: list[Status] = []

    def stopping(status: Status) -> None:
        seen.append(status)
        if status.state is LinkState.PAUSED:
            streamer.stop()

    streamer = streamer_of(job_of(zigzag(2000)), transport, tmp_path, stopping)
    status = streamer.run()
    assert LinkState.PAUSED in [one.state for one in seen]
    assert status.state is LinkState.STOPPED
    assert any("line errors" in text for text in read_journal(tmp_path / "journal.log").alarms)


class Refusing(FakeMarlin):
    """Doesn't take line ``at``, ``times`` times: ``how`` it answers."""

    def __init__(self, at: int, times: float, how: str) -> None:
        super().__init__()
        self.at_number, self.times, self.how, self.tries = at, times, how, 0

    def _take(self, line: str) -> bytes:
        if self.last < self.at_number - 1 or not line.startswith(f"N{self.last + 1} "):
            return super()._take(line)
        self.tries += 1
        if self.tries > self.times:
            self.tries = 0
            return super()._take(line)
        says = {"oks": b"ok\n", "swallows": b""}
        return says.get(self.how) or b"" if self.how in says else self._refuse("checksum mismatch")


@pytest.mark.parametrize("how", ["refuses", "swallows", "oks"])
def test_a_line_that_is_never_taken_ends_the_print(tmp_path, how):
    printer, clock = Refusing(60, np.inf, how), VirtualClock()
    streamer = streamer_of(job_of(zigzag(200)), FakeTransport(printer, clock), tmp_path)
    status = streamer.run()
    assert status.state is LinkState.FAILED
    assert not status.position_known
    assert "sent as N60)" in status.message
    assert f"{MAX_REFUSALS} tries" in status.message
    assert "check cable, earthing and firmware" in status.message
    assert "needle wasn't lifted" in status.message
    assert printer.last == 59
    assert ("checksum mismatch" in status.message) == (how == "refuses")
    history = read_journal(tmp_path / "journal.log")
    again = streamer_of(job_of(zigzag(200)), FakeTransport(printer, clock), tmp_path).run(history)
    assert (again.state, again.position_known) == (LinkState.FAILED, False)
    assert "sent as N60)" in again.message
    assert "`printctl recover`" in again.message
    assert printer.last == 59


def test_a_line_that_is_never_taken_in_the_handshake_begins_no_print(tmp_path):
    printer, clock = Refusing(2, np.inf, "refuses"), VirtualClock()
    status = streamer_of(job_of(zigzag(9)), FakeTransport(printer, clock), tmp_path).run()
    assert (status.state, status.error) == (LinkState.FAILED, "HandshakeError")
    assert "(a command, sent as N2)" in status.message


@pytest.mark.parametrize("how", ["refuses", "swallows"])
def test_a_line_that_is_refused_for_long_but_taken_ends_no_print(tmp_path, how):
    printer, clock = Refusing(60, MAX_REFUSALS - 1, how), VirtualClock()
    status = streamer_of(job_of(zigzag(30)), FakeTransport(printer, clock), tmp_path).run()
    assert status.state is LinkState.DONE
    assert [line for line in printer.numbered if line.startswith("G1")] == [
        line.decode() for line in zigzag(30)
    ]


def test_stop_before_the_first_line_sends_none(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    streamer = streamer_of(job_of(zigzag(30)), FakeTransport(printer, clock), tmp_path)
    streamer.stop()
    status = streamer.run()
    assert status.state is LinkState.STOPPED
    assert not any(line.startswith("G1") for line in printer.executed)


class StuckTransport(FakeTransport):
    """The cable takes no byte, until somebody writes past the queue."""

    def __init__(self, printer: FakeMarlin, clock: VirtualClock, stuck_at: bytes) -> None:
        super().__init__(printer, clock)
        self._stuck_at = stuck_at
        self.stuck, self.freed = threading.Event(), threading.Event()

    def write(self, data: bytes) -> None:
        if data.startswith(self._stuck_at):
            self.stuck.set()
            assert self.freed.wait(10)
        else:
            super().write(data)

    def write_urgent(self, data: bytes) -> None:
        self.waiting += self.printer.receive(data)
        self.freed.set()


def test_kill_leaves_while_a_write_is_stuck(tmp_path):
    printer = FakeMarlin()
    transport = StuckTransport(printer, VirtualClock(), b"N50 ")
    streamer = streamer_of(job_of(zigzag(100)), transport, tmp_path)
    result: list[Status] = []
    thread = threading.Thread(target=lambda: result.append(streamer.run()))
    thread.start()
    assert transport.stuck.wait(10)
    streamer.kill()
    thread.join(10)
    assert printer.halted
    assert result[0].state is LinkState.KILLED
    assert "M112 left the host after" in result[0].message
    assert len([line for line in printer.executed if line.startswith("G1")]) == 48  # and a token


def test_answers_to_the_kills_own_quickstop_are_no_other_program(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    transport = FakeTransport(printer, clock)

    def killing(status: Status) -> None:
        if status.lines_done > 50:
            streamer.kill()

    streamer = streamer_of(job_of(zigzag(3000)), transport, tmp_path, killing)
    status = streamer.run()
    assert status.state is LinkState.KILLED
    assert printer.executed.count("M410") == 2
    assert not read_journal(tmp_path / "journal.log").alarms


def test_kill_without_an_answer_pulls_the_reset_line(tmp_path, monkeypatch):
    monkeypatch.setattr(halting, "KILL_REPEAT_S", 0.001)
    printer, clock = FakeMarlin(), VirtualClock()
    transport = FakeTransport(printer, clock)

    def killing(status: Status) -> None:
        if status.lines_done > 50:
            printer.mute = True
            streamer.kill()

    streamer = streamer_of(job_of(zigzag(3000)), transport, tmp_path, killing)
    status = streamer.run()
    assert status.state is LinkState.KILLED
    assert "reset line" in status.message


def test_stop_after_homing_asks_where_the_needle_is(tmp_path):
    printer, clock = FakeMarlin(), VirtualClock()
    printer.at.update(Z=3.0, E=1.0)
    job = job_of([b"G28", *[b"M105"] * 3000])

    def stopping(status: Status) -> None:
        if status.lines_done > 10:
            streamer.stop()

    streamer = streamer_of(job, FakeTransport(printer, clock), tmp_path, stopping)
    assert streamer.run().state is LinkState.STOPPED
    assert printer.numbered[-3:] == ["G1 E0.90000 F30", "G1 Z23.00000 F300", "M400"]


class SurplusInPause(FakeTransport):
    """The line by which the plunger comes back from a pause is lost, and an ok of nobody's heard.

    The cable breaks in the write of `breaks_at`.
    """

    plunger_moves = 0
    breaks_at = b"G1 never"

    def write(self, data: bytes) -> None:
        if self.breaks_at in data:
            raise PortLost("the cable broke")
        if b" G1 E" in data:
            self.plunger_moves += 1
            if self.plunger_moves == 2:
                data = b""
                self.waiting += b"ok\n"
        super().write(data)


@pytest.mark.parametrize("breaks", [False, True])
def test_command_that_was_not_taken_after_all_is_counted_where_it_was(tmp_path, breaks):
    printer, clock = FakeMarlin(), VirtualClock()
    transport = SurplusInPause(printer, clock)
    lines = zigzag(100)
    if breaks:
        transport.breaks_at = lines[60]
    asked: list[Status] = []

    def pause_once(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            streamer.resume()

    streamer = streamer_of(job_of(lines), transport, tmp_path, pause_once)
    take = printer._take

    def taking(line: str) -> bytes:
        if line.split("*")[0].endswith(lines[19].decode()) and not asked:
            asked.append(streamer.status)
            streamer.pause()
        return take(line)

    printer._take = taking  # type: ignore[method-assign]
    status = streamer.run()
    assert transport.plunger_moves == 3
    history = read_journal(tmp_path / "journal.log")
    if breaks:
        assert status.error == "PortLost"
        assert history.job_line(printer.last) == 60
    else:
        assert status.state is LinkState.DONE, status
    assert {n: text for n, text in history.controls.items() if n > 20} == {
        n: text for n, text in printer.by_number.items() if n > 20 and text.encode() not in lines
    }


# --- manual commands during a print: judged by the gate, never ending the print
class Person:
    """Types once, and hears what came of it."""

    def __init__(self, *lines: str) -> None:
        self.lines = lines
        self.heard: list[tuple[bytes, ...]] = []
        self.refused: list[str] = []

    def __call__(self, streamer) -> None:
        self.type(self.lines, streamer)

    def type(self, lines: tuple[str, ...], streamer) -> None:
        for line in lines:
            try:
                streamer.typed(line, self.heard.append, self.refused.append)
            except Refused as exc:
                self.refused.append(str(exc))

    def in_pause(self, streamer) -> None:
        lines, self.lines = self.lines, ()
        if not lines:  # the needle was brought elsewhere, so that the print isn't gone on with
            streamer.stop()
            return
        self.type(lines, streamer)
        streamer.command(b"M105", lambda said: streamer.resume())


def printed_with(tmp_path, person: Person, paused: bool = False):
    data = layered(2, 20)
    request = (lambda streamer: streamer.pause()) if paused else person
    script = Script(at_line={12: request}, on_paused=person.in_pause)
    printer = Following(parse_job(data, "test.gcode"), script)
    transport = FakeTransport(printer, VirtualClock())
    before = len(printer.numbered)
    status = played(data, tmp_path, transport, script)
    return status, printer.numbered[before:]


@pytest.mark.parametrize(
    "line",
    ["G0 Z15 F60", "G 1 Z-50", "g1z2", "G1 F60", "G1 E5 F60", "G28", "G92 Z0", "G91", "M28", "M84"]
    + ["M104 S250", "M92 X1", "M221 S50", "M206 X1", "M211 S0", "M502", "M500", "M111 S8", "T1"]
    + ["M400", "M118 ok", "M112", "M999", "M410", "M108", "M85 S0", "M204 P1", "M302 P0"],
)
def test_what_moves_or_sets_is_refused_in_a_print_which_goes_on(tmp_path, line):
    person = Person(line)
    status, sent = printed_with(tmp_path, person)
    assert status.state is LinkState.DONE, status
    assert len(person.refused) == 1
    assert "printctl station" not in person.refused[0]  # it has no print to act on
    assert ("`printctl kill`" in person.refused[0]) == (line == "M112")
    plain = line.replace(" ", "").upper()
    assert plain not in {text.replace(" ", "") for text in sent if text not in ("M400",)}


def test_questions_fans_and_warmth_within_limits_go_out_in_a_print(tmp_path):
    person = Person("m 105", "M114", "M106 P0 S128", "M104 S37", "M140 S30")
    status, sent = printed_with(tmp_path, person)
    assert status.state is LinkState.DONE, status
    assert person.refused == []
    assert len(person.heard) == 5
    at = sent.index("M106 P0 S128")
    assert sent[at - 2 : at + 3] == ["M105", "M114", "M106 P0 S128", "M104 S37", "M140 S30"]


def test_a_question_that_the_firmware_doesnt_know_ends_no_print(tmp_path):
    person = Person("M119")
    data, script = layered(2, 20), Script(at_line={12: person})
    printer = Following(parse_job(data, "test.gcode"), script)
    said = printer._reply
    printer._reply = lambda word, text: (  # type: ignore[method-assign]
        'echo:Unknown command: "M119"\nok\n' if word == "M119" else said(word, text)
    )
    status = played(data, tmp_path, FakeTransport(printer, VirtualClock()), script)
    assert status.state is LinkState.DONE, status
    assert b"unknown command" in b" ".join(person.heard[0])


def test_in_a_pause_moves_go_by_limits_and_a_feed_of_their_own(tmp_path):
    person = Person("G1 X60", "G1 Z1", "G1 X900", "G1 Z500", "G0 F60000 X61", "G28")
    status, sent = printed_with(tmp_path, person, paused=True)
    assert status.state is LinkState.STOPPED, status
    moved = [text for text in sent if text.startswith("G1 X60")]
    assert moved == ["G1 X60 F300"]
    assert len(person.refused) == 5
    assert "where the pause left it" in person.refused[0]
    assert not any("X900" in text or "Z500" in text or text == "G28" for text in sent)


def test_in_a_pause_the_plunger_goes_no_faster_than_it_may(tmp_path):
    person = Person("G1 E-5 F60", "G1 E0 F60000", "G1 E900 F60", "G1 X51 E0 F60")
    status, sent = printed_with(tmp_path, person, paused=True)
    assert status.state is LinkState.DONE, status
    assert "G1 E-5 F60" in sent
    assert len(person.refused) == 3


def test_alarm_of_whoever_hears_of_the_end_is_in_the_journal(tmp_path):
    def hear(status: Status) -> None:
        if status.ended:
            streamer.alarm("the wire log ends here")

    transport = FakeTransport(FakeMarlin(), VirtualClock())
    streamer = streamer_of(job_of(zigzag(3)), transport, tmp_path, hear)
    streamer.run()
    assert "the wire log ends here" in read_journal(tmp_path / "journal.log").alarms
