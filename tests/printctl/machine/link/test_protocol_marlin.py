"""Marlin's link protocol, byte by byte, against recorded replies."""

from __future__ import annotations

from firmware_profiles.families.link_protocol import (
    CommandReplied,
    Fault,
    FirmwareHalted,
    FirmwareReset,
    LinesResent,
    Notice,
    Renumbered,
    StrayOk,
    Synchronised,
    TokenSent,
)
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.marlin.state import QUESTION, RENUMBER

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


def test_one_line_in_flight():
    protocol = started()
    assert not protocol.feed(b"o", 0.1)
    assert protocol.take_output() == b""
    assert not protocol.feed(b"k\n", 0.1)
    assert protocol.take_output() == frame(2, JOB[1])
    assert protocol.lines_done == 1


def test_resend_repeats_only_the_lost_line():
    protocol = started()
    protocol.feed(b"ok\n", 0.0)
    protocol.take_output()
    protocol.feed(b"Error:checksum mismatch, Last Line: 1\nResend: 2\nok\n", 1.0)
    assert protocol.take_output() == b""  # nothing while a reply may be under way
    now = ask(protocol, 1.0)
    settle(protocol, 1, now)
    assert protocol.take_output() == frame(2, JOB[1])
    assert (protocol.lines_done, protocol.line_errors) == (1, 1)


def test_garbled_resend_number_is_not_believed():
    protocol = started()
    protocol.feed(b"Resend: 9\nok\n", 1.0)
    now = ask(protocol, 1.0)
    settle(protocol, 0, now)
    assert protocol.take_output() == frame(1, JOB[0])


def test_answer_whose_halves_disagree_is_asked_for_again():
    protocol = started()
    protocol.feed(b"?\n", 1.0)
    now = ask(protocol, 1.0)
    protocol.feed(answer(0).replace(b"Resend: 1", b"Resend: 3"), now)
    protocol.tick(now + 0.051)
    assert protocol.take_output() == b""
    now = ask(protocol, now + 0.051)
    settle(protocol, 0, now)
    assert protocol.take_output() == frame(1, JOB[0])


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


def test_busy_printer_is_waited_for():
    protocol = started()
    for second in range(1, 60):
        assert not protocol.feed(b"echo:busy: processing\n", float(second))
        assert not protocol.tick(second + 0.9)
        assert protocol.take_output() == b""


def test_reports_are_no_sign_of_life():
    protocol = started()
    protocol.feed(b" T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0\n", 2.0)
    protocol.tick(2.6)
    assert protocol.take_output() == QUESTION


def test_taken_line_with_a_blocked_planner_is_waited_for_not_repeated():
    protocol = started()
    protocol.feed(b"ech\x00:bus\x01: proc\n", 1.0)  # garbled, the ok is still to come
    now = ask(protocol, 1.0)
    settle(protocol, 1, now)
    assert protocol.take_output() == TOKEN
    protocol.feed(b"ok\n", 2.0)
    assert protocol.take_output() == b""
    protocol.feed(b"echo:at 2.1\nok\n", 2.0)
    assert protocol.take_output() == frame(3, JOB[1])


def test_fragment_of_a_garbled_line_is_not_taken_for_an_acknowledgement():
    protocol = started()
    protocol.feed(b'echo:Unknown command: "O1 G1 X1"\nok\n', 1.0)
    now = ask(protocol, 1.0)
    settle(protocol, 0, now)
    assert protocol.take_output() == frame(1, JOB[0])


def test_unknown_command_is_a_fault_although_ok_follows():
    protocol = started()
    events = protocol.feed(b'echo:Unknown command: "G1 X1"\nok\n', 1.0)
    assert next(event for event in events if isinstance(event, Fault)).line == 1
    settle(protocol, 1, ask(protocol, 1.0))
    assert b"G1" not in protocol.take_output()


def test_cold_extrusion_is_a_fault_although_ok_follows():
    protocol = started()
    events = protocol.feed(b"echo: cold extrusion prevented\nok\n", 1.0)
    assert events == [Fault("echo: cold extrusion prevented", 1, True, about_command=True)]
    assert protocol.lines_done == 1


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


def test_halt_ends_everything():
    protocol = started()
    said = b"echo:M112 Shutdown\nError:Printer halted. kill() called!\n//action:poweroff\n"
    assert any(isinstance(event, FirmwareHalted) for event in protocol.feed(said, 1.0))
    protocol.take_output()
    assert not protocol.tick(100.0)
    assert protocol.take_output() == b""


def test_advanced_ok_to_another_line_is_doubted():
    protocol = started()
    protocol.feed(b"ok N1 P15 B3\n", 0.0)
    assert protocol.take_output() == frame(2, JOB[1])
    protocol.feed(b"ok N1 P15 B3\n", 0.1)
    assert protocol.lines_done == 1
    now = ask(protocol, 0.1)
    settle(protocol, 1, now)
    assert protocol.take_output() == frame(2, JOB[1])


def test_manual_command_is_numbered_and_goes_between_two_lines():
    protocol = started()
    protocol.submit(b"M105", 0.0)
    assert protocol.take_output() == b""
    protocol.feed(b"ok\n", 0.0)
    assert protocol.take_output() == frame(2, b"M105")
    events = protocol.feed(b"ok T:21.00 /0.00 @:0\n", 0.1)
    assert events == [CommandReplied(b"M105", 2, (b"ok T:21.00 /0.00 @:0",))]
    assert protocol.take_output() == frame(3, JOB[1])
    assert protocol.lines_done == 1


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
