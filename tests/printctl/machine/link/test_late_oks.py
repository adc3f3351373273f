"""Late oks: none is taken as the answer to a later line."""

from __future__ import annotations

from firmware_profiles.families.harmless_query import QUESTION
from firmware_profiles.families.link_protocol import (
    CommandReplied,
    LinesResent,
    Notice,
    StrayOk,
    Synchronised,
    TokenSent,
)
from firmware_profiles.families.marlin.bit_flips import guard_command
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame

JOB = [b"G1 X%d" % k for k in range(1, 41)]


def answer(last: int) -> bytes:
    return b"Error:Line Number is not Last Line Number+1, Last Line: %d\nResend: %d\nok\n" % (
        last,
        last + 1,
    )


def started(first: int = 30) -> MarlinProtocol:
    """Line ``first`` + 1 is in flight at time 0."""
    protocol = MarlinProtocol()
    protocol.load(JOB, first, first)
    protocol.held = False
    protocol.go(0.0)
    assert protocol.take_output() == frame(first + 1, JOB[first])
    return protocol


def silent_then_taken(protocol: MarlinProtocol, last: int, now: float = 0.0) -> list:
    """Fall silent; say that the line in flight was taken; give the events of what follows."""
    protocol.tick(now + 2.6)
    assert protocol.take_output() == QUESTION
    events = list(protocol.feed(answer(last), now + 2.62))
    return [*events, *protocol.tick(now + 2.7)]


def token_of(events: list, protocol: MarlinProtocol) -> TokenSent:
    (sent,) = [event for event in events if isinstance(event, TokenSent)]
    assert protocol.take_output() == frame(sent.number, guard_command(sent.command))
    return sent


def echo_of(token: TokenSent) -> bytes:
    return b"echo:" + token.command.removeprefix(b"M118 E1 ") + b"\n"


def test_ok_that_comes_after_the_question_is_not_the_next_lines():
    """Found on a real Marlin: each later ok was one line early, and the print was done too soon."""
    protocol = started()
    token = token_of(silent_then_taken(protocol, 31), protocol)
    assert protocol.lines_done == 31  # it is taken, as the printer says
    assert not protocol.feed(b"ok\n", 3.2)  # line 31's, 0.57 s later
    assert protocol.take_output() == b""
    protocol.feed(echo_of(token), 3.3)
    assert protocol.take_output() == b""
    protocol.feed(b"ok\n", 3.3)
    assert protocol.take_output() == frame(token.number + 1, JOB[31])


def test_answer_of_a_command_is_awaited_until_the_token_behind_it_comes_back():
    """M400 isn't answered by the ok of the line before it."""
    protocol = MarlinProtocol()
    protocol.load(JOB, 40, 40)
    protocol.submit(b"M400", 0.0)
    assert protocol.take_output() == frame(41, b"M0400")
    events = silent_then_taken(protocol, 41)
    token = token_of(events, protocol)
    assert not any(isinstance(event, CommandReplied) for event in events)
    assert not protocol.feed(b"ok\n", 3.0)
    assert not protocol.feed(echo_of(token), 9.0)
    assert protocol.feed(b"ok\n", 9.0) == [CommandReplied(b"M0400", 41, ())]
    assert protocol.idle


def test_several_oks_that_come_in_one_read_move_nothing_forward():
    protocol = started()
    token = token_of(silent_then_taken(protocol, 31), protocol)
    assert protocol.feed(b"ok\nok\nok\n", 3.0) == []
    assert protocol.take_output() == b""
    events = protocol.feed(echo_of(token) + b"ok\n", 3.1)
    assert [type(event) for event in events] == [StrayOk]  # two oks belong to no line
    assert protocol.take_output() == b""
    assert protocol.held


def test_line_that_was_not_taken_after_all_is_noticed_at_the_token():
    protocol = started()
    protocol.feed(b"Error:checksum mismatch, Last Line: 30\nResend: 31\nok\n", 0.1)
    protocol.tick(0.2)
    protocol.take_output()
    protocol.feed(answer(30), 0.2)
    protocol.tick(0.3)
    protocol.take_output()
    token_of(list(protocol.feed(b"ok\n", 0.4)), protocol)  # a fragment's; line 31 was garbled again
    protocol.feed(answer(30), 0.5)
    for now in (0.6, 0.8):
        protocol.tick(now)
        assert protocol.take_output() == QUESTION
        protocol.feed(answer(30), now)
        events = protocol.tick(now + 0.1)
    assert events == [LinesResent(31, 31)]
    protocol.held = False
    protocol.go(1.0)
    assert protocol.take_output() == frame(31, JOB[30])


def test_confirming_waits_for_the_echo_however_many_oks_come():
    protocol = MarlinProtocol()
    protocol.load(JOB, 40, 40)
    protocol.confirm(0.0)
    assert protocol.take_output() == b""  # it is written down first
    token = token_of(list(protocol.tick(0.0)), protocol)
    assert not any(isinstance(e, Synchronised) for e in protocol.feed(b"ok\nok\n", 0.1))
    events = protocol.feed(echo_of(token) + b"ok\n", 0.2)
    assert Synchronised(41) in events
    assert protocol.idle


def test_slow_board_is_asked_again_within_two_seconds_and_waited_for():
    """Taken, and its echo not back: no more tokens than the board's queue has room for."""
    protocol = started()
    token = token_of(silent_then_taken(protocol, 31), protocol)
    now, asked_s, tokens = 2.7, 2.7, 0
    while now < 600.0:
        now = max(now, protocol.deadline)
        events = list(protocol.tick(now))
        assert all(isinstance(event, Notice | TokenSent) for event in events)
        tokens += sum(isinstance(event, TokenSent) for event in events)
        if QUESTION in protocol.take_output():
            assert now - asked_s < 2.0
            asked_s = now
            protocol.feed(b"echo:busy: processing\n" + answer(32 + tokens), now)
    assert tokens <= 1
    assert token
