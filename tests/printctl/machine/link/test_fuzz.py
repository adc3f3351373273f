"""Fuzzed printer replies, in any family: no crash, wrong line or move."""

from __future__ import annotations

import re
import tempfile
from collections import deque
from itertools import groupby
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.reprapfirmware.facts import crc16
from firmware_profiles.families.timing import Timing
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.ports.clock import VirtualClock
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.fake_marlin import FakeMarlin, zigzag
from tests.printctl.machine.link.jobs import close_all, parse_job
from tests.printctl.machine.link.protocols import STREAMED
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.simulated import wired
from tests.slower import examples

WORDS = [
    b"ok\n",
    b"ok\r\n",
    b"ok T:21.0 /0.0 B:21.0 /0.0 @:0 B@:0\n",
    b"ok N3 P15 B3\n",
    b"Resend: 3\nok\n",
    b"Resend: 99999999\nok\n",
    b"Error:checksum mismatch, Last Line: 2\nResend: 3\nok\n",
    b"Error:Line Number is not Last Line Number+1, Last Line: 4\nResend: 5\nok\n",
    b"Error:Printer halted. kill() called!\n",
    b"Error: G999: Command is not supported\nok\n",
    b"Error:",
    b"echo:busy: processing\n",
    b'echo:Unknown command: "G1 X1"\nok\n',
    b"echo: cold extrusion prevented\n",
    b"Unknown M code: M113\n",
    b"start\n",
    b"Marlin 2.1.2\n",
    b"wait\n",
    b"//action:pause\n",
    b"//action:cancel\n",
    b"//action:resume\n",
    b"// Klipper state: Ready\n",
    b"// Klipper state: Shutdown\n",
    b'// Unknown command:"G999"\nok\n',
    b"!! Move out of range\n",
    b"!!\n",
    b"Emergency Stop! Reset the controller to continue.\n",
    b"X:50.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0\n",
    b"X:nan Y:1e9 Z:-\n",
    b"FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0\n",
    b"FIRMWARE_NAME:Marlin\nCap:EMERGENCY_PARSER:1\n",
    b"  M92 X80.00 Y80.00 Z400.00 E6400.00\n",
    b"  M92 X0 Y80.. Z E\n",
    b"\x00\xff" * 30,
    b"x" * 5000,
    b"\n\n\r\n",
]
FAKES = {
    "marlin": FakeMarlin,
    "pairs": FakeMarlin,
    "withheld": FakeMarlin,
    "prusa": FakeMarlin,
    "reprapfirmware": FakeDuet,
    "klipper": FakeKlipper,
}
TWO_IN_FLIGHT = ("pairs", "withheld")
JOB = zigzag(12)
FILE = [line.decode() for line in JOB]


@st.composite
def garbled(draw) -> bytes:
    """A word with flipped bits, or a part of it."""
    text = bytearray(draw(st.sampled_from(WORDS)))
    for _ in range(draw(st.integers(0, 3))):
        text[draw(st.integers(0, len(text) - 1))] ^= 1 << draw(st.integers(0, 7))
    begin = draw(st.integers(0, len(text)))
    return bytes(text[begin:] if draw(st.booleans()) else text[:begin])


UTTERANCE = st.one_of(st.sampled_from(WORDS), garbled(), st.binary(max_size=60))


def facts(family: str) -> Printer:
    two = family in TWO_IN_FLIGHT
    changes = {"firmware": "marlin" if two else family, "resets_on_connect": False}
    changes["lines_in_flight"] = 2 if two else 1
    return load(Printer, "generic_marlin").model_copy(update=changes)


def protocol_of(family: str):
    if family in TWO_IN_FLIGHT:
        return MarlinProtocol(Timing(calm_lines=0), Pairing(128, family == "withheld"))
    return protocol_for(facts(family), 0.05)


def frames(family: str) -> set[bytes]:
    """Every line of the job as it may be sent, without line end."""
    if family == "klipper":
        return set(JOB)
    if family == "reprapfirmware":
        bodies = [b"N%d %b" % (n + 1, line) for n, line in enumerate(JOB)]
        return {b"%b*%05d" % (body, crc16(body)) for body in bodies}
    whole = {frame(n + 1, line).rstrip() for n, line in enumerate(JOB)}
    return whole | ({line[:-1] for line in whole} if family == "withheld" else set())


_QUESTIONS = re.compile(
    rb"N99999999 M105\*23$|N\d+ (M114|M105)\*\d{5}$|M1(05|14)$|STATUS$"
    rb"|N(\d+) M110 N\3\*\d{1,3}$"
)
"""Queries of each family, and the command that sets a count back."""


@pytest.mark.parametrize("family", FAKES)
@settings(max_examples=examples(80), deadline=None, suppress_health_check=list(HealthCheck))
@given(said=st.lists(st.tuples(UTTERANCE, st.floats(0.0, 5.0)), max_size=30))
def test_no_line_leaves_under_a_wrong_number_or_in_other_words(family, said):
    protocol, allowed = protocol_of(family), frames(family)
    protocol.load(JOB, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    sent, now = protocol.take_output(), 0.0
    for data, pause in said:
        protocol.feed(data, now)
        now += pause
        protocol.tick(now)
        sent += protocol.take_output()
    *lines, _ = sent.split(b"\n")
    for line in filter(None, lines):
        assert line in allowed or _QUESTIONS.match(line), line


@pytest.mark.parametrize("family", FAKES)
@settings(max_examples=examples(40), deadline=None, suppress_health_check=list(HealthCheck))
@given(said=st.lists(st.tuples(st.integers(0, 12), st.booleans(), UTTERANCE), max_size=12))
def test_whole_print_ends_and_moves_only_along_the_file(family, said):
    fake, script = FAKES[family](), deque(said)
    left = script[0][0] if script else 0

    def answer(data: bytes) -> bytes:
        """The firmware's own words, until it is the turn of others, in place of them or before."""
        nonlocal left
        real = fake.receive(data)
        if not script or left > 0:
            left -= 1
            return real
        _, instead, words = script.popleft()
        left = script[0][0] if script else 0
        return words if instead else words + real

    with tempfile.TemporaryDirectory() as folder:
        streamer: list[Streamer] = []
        one = wired(
            ScriptedTransport(answer, VirtualClock()),
            Path(folder),
            parse_job(b"\n".join(JOB), "test.gcode"),
            facts(family),
            protocol=protocol_of(family),
            on_status=lambda status: streamer[0].resume() if status.state == "paused" else None,
        )
        streamer.append(one)
        status = one.run()
        close_all()
    assert status.ended
    moves = [line for line in fake.executed if re.match(r"G[0123]\b", line)]
    ours = [line for line, _ in groupby(line for line in moves if line in FILE)]
    assert ours == FILE[: len(ours)]
    for line in moves:  # else the plunger's relief and priming, or straight up and down
        assert line in FILE or re.fullmatch(r"G1 [EZ]-?[\d.]+ F\d+|G1 F\d+", line), line
    if status.state == "done":
        assert ours == FILE


def test_every_family_is_fuzzed():
    assert set(FAKES) == {*STREAMED, *TWO_IN_FLIGHT}
