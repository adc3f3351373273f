"""Klipper's shutdown reason, queried after the shutdown."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from threading import Thread

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.states import LinkState
from printctl.machine.link.streamer import Streamer
from tests.printctl.machine.link.fake_families import FakeKlipper
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.test_families import JOB, streamer_of

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
