"""Streamer against a fake Marlin, in virtual time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from printctl.machine.link import kill
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import PortLost
from printctl.machine.link.job import Job
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.jobs import parse_job
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
    monkeypatch.setattr(kill, "KILL_REPEAT_S", 0.001)
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
