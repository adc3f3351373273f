"""Garbled echo of a synchronisation token: queried again at once."""

from __future__ import annotations

import pytest

from firmware_profiles.families.marlin.protocol import MarlinProtocol

JOB = [b"G1 X%d" % k for k in range(1, 101)]
GARBLED = [
    b"echo:at 3.q",
    b"echo:it 3.1",
    b"echn:at 3.1",
    b"at s.1",
    b"echo:at3.1",
    b"echo: at 3.1\x8a",
]


def waiting_for_echo() -> MarlinProtocol:
    """Line 2 of the job was taken after a doubt; a token is behind it."""
    protocol = MarlinProtocol()
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    protocol.feed(b"ok\n", 0.1)
    protocol.feed(b"o\x8a\n", 0.2)
    protocol.tick(0.3)
    protocol.take_output()
    protocol.feed(
        b"Error:Line Number is not Last Line Number+1, Last Line: 2\nResend: 3\nok\n", 0.4
    )
    protocol.tick(protocol.deadline)
    assert b"M0118 E1 at 3.1*" in protocol.take_output()
    return protocol


@pytest.mark.parametrize("echo", GARBLED)
def test_a_garbled_echo_is_followed_by_a_question_and_another_token_at_once(echo):
    protocol = waiting_for_echo()
    begun = 0.5
    protocol.feed(echo + b"\nok\n", begun)
    while b"M0118" not in (sent := protocol.take_output()):
        assert b"G1" not in sent
        now = protocol.deadline
        assert now < begun + 0.5
        protocol.tick(now)
        if b"M0118" not in (sent := protocol.take_output()):
            answer = b"Error:Line Number is not Last Line Number+1, Last Line: 3\nResend: 4\nok\n"
            protocol.feed(answer, now)
            continue
        break
    assert b"at 4.2*" in sent
    protocol.feed(b"echo:at 4.2\nok\n", 1.0)
    assert b"G1 X3" in protocol.take_output()
