"""Late oks: none is taken as the answer to a later line."""

from __future__ import annotations

from firmware_profiles.families.link_protocol import (
    QUESTION,
    CommandReplied,
    LinesResent,
    Notice,
    StrayOk,
    Synchronised,
    TokenSent,
)
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.marlin.sender import guard_command

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


def test_ok_that_was_lost_is_not_waited_for():
    protocol = started()
    token = token_of(silent_then_taken(protocol, 31), protocol)
    protocol.feed(echo_of(token) + b"ok\n", 3.3)
    assert protocol.take_output() == frame(33, JOB[31])


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


def test_garbled_echo_is_asked_for_anew_with_another_text():
    protocol = started()
    first = token_of(silent_then_taken(protocol, 31), protocol)
    protocol.feed(b"ok\n" + echo_of(first).replace(b"a", b"\x01") + b"ok\n", 3.0)
    protocol.tick(3.1)
    assert protocol.take_output() == QUESTION
    protocol.feed(answer(32), 3.12)
    second = token_of(list(protocol.tick(3.2)), protocol)
    assert second.number == 33
    assert second.command != first.command
    protocol.feed(echo_of(second) + b"ok\n", 3.3)
    assert protocol.take_output() == frame(34, JOB[31])


def test_echo_of_a_token_without_its_number_is_no_evidence():
    """A tail of the line, run unchecked, says its checksum as well."""
    protocol = started()
    token = token_of(silent_then_taken(protocol, 31), protocol)
    protocol.feed(echo_of(token).replace(b"\n", b"*77\n") + b"ok\n", 3.3)
    assert protocol.take_output() == b""
    assert not protocol.idle


def test_unknown_command_that_quotes_the_token_is_its_echo():
    protocol = started()
    token = token_of(silent_then_taken(protocol, 31), protocol)
    quoted = b'echo:Unknown command: "%b"\nok\n' % guard_command(token.command)
    assert not protocol.feed(quoted, 3.3)
    assert protocol.take_output() == frame(33, JOB[31])


def test_line_sent_again_is_followed_by_a_token():
    """An ok of a fragment may come at any time after the question: it releases one line at most."""
    protocol = started()
    protocol.feed(b"Error:checksum mismatch, Last Line: 30\nResend: 31\nok\n", 0.1)
    protocol.tick(0.2)
    assert protocol.take_output() == QUESTION
    protocol.feed(answer(30), 0.2)
    protocol.tick(0.3)
    assert protocol.take_output() == frame(31, JOB[30])
    token = token_of(list(protocol.feed(b"ok\n", 0.4)), protocol)  # the fragment's
    assert protocol.feed(b"ok\n" + echo_of(token) + b"ok\n", 5.0) == [StrayOk(32)]
    assert protocol.held
    assert protocol.take_output() == b""


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
