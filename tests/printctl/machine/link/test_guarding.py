"""Sent lines: no single flipped bit turns one into a stop code."""

from __future__ import annotations

import pytest

from firmware_profiles.families.marlin.sender import guard_command
from firmware_profiles.families.marlin.state import QUESTION, RENUMBER
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.states import LinkState
from sim.devices.board.wire import Wire
from sim.devices.families.marlin.numbering import EMERGENCY
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.test_streamer import job_of, streamer_of


def seen_by_the_emergency_parser(line: bytes) -> list[bytes]:
    wire = Wire(250_000, 128, EMERGENCY)
    wire.send(0.0, line)
    wire.deliver(1.0)
    return wire.urgent


def flipped(line: bytes) -> list[bytes]:
    return [
        line[:place] + bytes([line[place] ^ 1 << bit]) + line[place + 1 :]
        for place in range(len(line) - 1)
        for bit in range(8)
    ]


def written_in_a_print(tmp_path) -> list[bytes]:
    """All lines of a print with a pause, renumbering apart, which comes before any move."""
    printer, clock = FakeMarlin(), VirtualClock()
    transport = FakeTransport(printer, clock)
    job = job_of([b"M104 S37", b"M400", b"M114", *zigzag(20)])

    def on_status(status):
        if status.state is LinkState.PAUSED:
            streamer.resume()

    streamer = streamer_of(job, transport, tmp_path, on_status)
    streamer.pause()
    assert streamer.run().state is LinkState.DONE
    lines = {line + b"\n" for line in bytes(transport.written).split(b"\n") if line}
    return sorted(lines - {RENUMBER.strip() + b"\n"})


def test_no_flipped_bit_makes_a_stop_or_a_renumbering_of_what_is_sent(tmp_path):
    lines = written_in_a_print(tmp_path)
    assert QUESTION.strip() + b"\n" in lines
    for line in lines:
        for garbled in flipped(line):
            assert not {b"112", b"410"}.intersection(seen_by_the_emergency_parser(garbled)), garbled
            assert b"M110" not in garbled


def test_flipped_bit_of_an_unguarded_command_is_a_stop():
    assert seen_by_the_emergency_parser(b"N7 M112*99\n") == [b"112"]
    assert seen_by_the_emergency_parser(b"N7 M 112*99\n") == [b"112"]
    assert seen_by_the_emergency_parser(b"N7 M0112*99\n") == []


@pytest.mark.parametrize(
    ("command", "sent"),
    [
        (b"M113 S1", b"M0113 S1"),
        (b"M400", b"M0400"),
        (b"M114", b"M0114"),
        (b"M105", b"M105"),
        (b"M112", b"M112"),
        (b"M110 N0", b"M110 N0"),
        (b"M4000", b"M4000"),
        (b"G1 X1", b"G1 X1"),
        (b"M118 " + b"a" * 60, b"M118 " + b"a" * 60),
    ],
)
def test_only_what_is_near_gets_a_zero(command, sent):
    assert guard_command(command) == sent
