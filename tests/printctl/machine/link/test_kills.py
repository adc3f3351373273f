"""Kills on a wire that is stuck, silent or full, and requests to a streamer as it runs."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from printctl.machine.control.board import halting
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import PortLost
from printctl.machine.job.job import Job
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
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

    def write_halt(self, data: bytes) -> None:
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
    assert printer.executed.count("M410") == 3
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


def test_alarm_of_whoever_hears_of_the_end_is_in_the_journal(tmp_path):
    def hear(status: Status) -> None:
        if status.ended:
            streamer.alarm("the wire log ends here")

    transport = FakeTransport(FakeMarlin(), VirtualClock())
    streamer = streamer_of(job_of(zigzag(3)), transport, tmp_path, hear)
    streamer.run()
    assert "the wire log ends here" in read_journal(tmp_path / "journal.log").alarms


class FullWire(FakeTransport):
    """Takes nothing that is urgent at first."""

    refusals = 3

    def write_halt(self, data: bytes) -> None:
        self.refusals -= 1
        if self.refusals >= 0:
            raise PortLost("resource temporarily unavailable")
        self.write(data)


def test_kill_is_tried_again_on_a_wire_that_takes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(halting, "KILL_REPEAT_S", 0.001)
    printer = FakeMarlin()
    transport = FullWire(printer, VirtualClock())
    threads: list[threading.Thread] = []

    def on_status(status: Status) -> None:
        if status.lines_done > 50 and not threads:
            threads.append(threading.Thread(target=streamer.kill))
            threads[0].start()
            threads[0].join(0.05)

    streamer = streamer_of(job_of(zigzag(3000)), transport, tmp_path, on_status)
    status = streamer.run()
    threads[0].join(10)
    assert transport.refusals < 0
    assert status.state is LinkState.KILLED
    assert b"M112" in b"".join(transport.written)
