"""Klipper says why it has shut down only when it is asked."""

from __future__ import annotations

from firmware_profiles.families import link_protocol as said
from firmware_profiles.families.klipper.protocol import KlipperProtocol

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
    assert machine.feed(b"// Klipper state: Shutdown\n", 1.0) == []
    assert machine.take_output() == b"STATUS\n"
    events = machine.feed(b"ok\n" + WHY + b"!! MCU 'mcu' shutdown: Timer too close\nok\n", 1.1)
    assert events == [
        said.Halted("// Klipper state: Shutdown: MCU 'mcu' shutdown: Timer too close")
    ]
    assert machine.take_output() == b""


def test_a_shutdown_without_a_reason_is_told_soon() -> None:
    machine = in_a_job()
    machine.feed(b"// Klipper state: Shutdown\nok\n", 1.0)
    assert machine.tick(1.2) == []
    assert machine.deadline < 2.0
    assert machine.tick(machine.deadline) == [said.Halted("// Klipper state: Shutdown")]
    assert machine.take_output() == b"STATUS\n"  # and no line of the job
