"""Marlin's link protocol, byte by byte, against recorded replies."""

from __future__ import annotations

from firmware_profiles.families.link_protocol import (
    CommandReplied,
    FirmwareReset,
    LinesResent,
    Notice,
    Renumbered,
    StrayOk,
    Synchronised,
    TokenSent,
)
from firmware_profiles.families.marlin.doubt import QUESTION, RENUMBER
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame

JOB = [b"G1 X1", b"G1 X2", b"G1 X3", b"G1 X4"]
TOKEN = frame(2, b"M0118 E1 at 2.1")


def answer(last: int) -> bytes:
    return b"Error:Line Number is not Last Line Number+1, Last Line: %d\nResend: %d\nok\n" % (
        last,
        last + 1,
    )


def started() -> MarlinProtocol:
    """Past the handshake, with the job's first line in flight at time 0."""
    protocol = MarlinProtocol()
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    assert protocol.take_output() == frame(1, JOB[0])
    return protocol


def ask(protocol: MarlinProtocol, now: float) -> float:
    """Let quiet pass; the protocol must ask."""
    assert not protocol.tick(now + 0.051)
    assert protocol.take_output() == QUESTION
    return now + 0.051


def settle(protocol: MarlinProtocol, last: int, now: float) -> list:
    """Answer a question, and let quiet pass."""
    events = list(protocol.feed(answer(last), now))
    assert protocol.take_output() == b""
    return [*events, *protocol.tick(now + 0.051)]


def test_silence_asks_which_line_was_taken_and_goes_on():
    protocol = started()
    assert not protocol.tick(2.4)
    assert not protocol.tick(2.6)
    assert protocol.take_output() == QUESTION
    events = settle(protocol, 1, 2.7)
    assert [type(event) for event in events] == [Notice, TokenSent]
    assert protocol.take_output() == TOKEN
    protocol.feed(b"echo:at 2.1\nok\n", 2.8)  # the ok was lost
    assert protocol.take_output() == frame(3, JOB[1])


def test_lines_acknowledged_by_a_surplus_ok_are_sent_again_once_confirmed():
    protocol = started()
    protocol.feed(b"ok\n", 0.0)
    protocol.take_output()
    protocol.feed(b"ok\n", 0.0)  # a fragment's
    protocol.take_output()
    protocol.feed(b"Error:checksum mismatch, Last Line: 1\nResend: 2\nok\n", 1.0)
    now = ask(protocol, 1.0)
    settle(protocol, 1, now)
    assert protocol.take_output() == b""  # once isn't enough
    now = ask(protocol, now + 0.051)
    assert settle(protocol, 1, now) == [LinesResent(2, 2)]
    assert protocol.take_output() == b""  # the position is to be verified first
    protocol.held = False
    protocol.go(now)
    assert protocol.take_output() == frame(2, JOB[1])
    assert protocol.lines_done == 1


def test_fragment_that_was_done_holds_the_job_until_the_position_is_verified():
    protocol = started()
    said = b"Error:No Checksum with line number, Last Line: 0\nResend: 1\nok\nok\n"
    protocol.feed(said, 1.0)
    now = ask(protocol, 1.0)
    assert settle(protocol, 0, now) == [StrayOk(1)]
    assert protocol.take_output() == b""
    protocol.submit(b"M114", now)
    assert protocol.take_output() == frame(1, b"M0114")
    protocol.feed(b"ok\n", now)
    assert protocol.take_output() == TOKEN
    assert CommandReplied(b"M0114", 1, ()) in protocol.feed(b"echo:at 2.1\nok\n", now)
    protocol.held = False
    protocol.go(now)
    assert protocol.take_output() == frame(3, JOB[0])


def test_count_that_another_program_has_changed_is_set_back_and_the_job_held():
    protocol = started()
    protocol.feed(b"?\n", 1.0)
    now = ask(protocol, 1.0)
    settle(protocol, 500, now)
    now = ask(protocol, now + 0.051)
    assert settle(protocol, 500, now) == [Renumbered(500, 0)]
    assert protocol.take_output() == b"\n" + frame(0, b"M110 N0")
    now = ask(protocol, now + 0.051)
    assert settle(protocol, 0, now) == [StrayOk(1)]
    assert protocol.held
    assert protocol.idle


def test_reset_in_mid_job_ends_it_even_if_start_was_garbled():
    for said in (b"start\n", b"Marlin 2.1.2\n"):
        protocol = started()
        protocol.feed(b"ok\n", 0.0)
        assert protocol.feed(said, 1.0) == [FirmwareReset()]
        protocol.take_output()
        protocol.feed(b"ok\n", 1.1)
        assert protocol.take_output() == b""
    protocol = started()
    protocol.feed(b"ok\n", 0.0)
    protocol.take_output()
    protocol.feed(b"st\x00rt\n", 1.0)
    now = ask(protocol, 1.0)
    assert settle(protocol, 0, now) == []
    now = ask(protocol, now + 0.051)
    assert settle(protocol, 0, now) == [Renumbered(0, 1)]  # the position then tells
    assert protocol.held


def test_renumbering_is_repeated_until_the_printer_confirms_it():
    protocol = MarlinProtocol()
    protocol.renumber(0.0)
    assert protocol.take_output() == RENUMBER
    now = ask(protocol, 0.0)
    protocol.feed(answer(7), now)
    protocol.tick(now + 0.051)
    assert protocol.take_output() == RENUMBER
    now = ask(protocol, now + 0.051)
    assert settle(protocol, 0, now) == [Synchronised(0)]
    assert protocol.idle
