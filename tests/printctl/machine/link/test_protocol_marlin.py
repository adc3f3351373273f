"""Marlin's link protocol, byte by byte, against recorded replies."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_profiles import Printer, ProfileError, load
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import (
    CommandReplied,
    Fault,
    FirmwareReset,
    LinesResent,
    Notice,
    Renumbered,
    StrayOk,
    TokenSent,
)
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import Kind, classify, frame
from firmware_profiles.families.marlin.sender import guard_command
from firmware_profiles.families.marlin.state import QUESTION, RENUMBER
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.timing import Timing
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import read_records
from printctl.machine.records.states import LinkState
from sim.devices.board.wire import Wire
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.families.marlin_reports import EMERGENCY
from tests.printctl.machine.control.bench import Bench, pause, resume
from tests.printctl.machine.link.fake_marlin import FakeMarlin, zigzag
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import (
    PRINTER,
    START,
    foreseen,
    gcode,
    printed,
    same_motion,
    wire,
    wired,
)
from tests.slower import first_rows

JOB = [b"G1 X1", b"G1 X2", b"G1 X3", b"G1 X4"]
TOKEN = frame(2, b"M0118 E1 at 2.1")


def answer(last: int) -> bytes:
    return b"Error:Line Number is not Last Line Number+1, Last Line: %d\nResend: %d\nok\n" % (
        last,
        last + 1,
    )


def started(job: list[bytes] = JOB, first: int = 0) -> MarlinProtocol:
    """Past the handshake, with line ``first`` + 1 of the job in flight at time 0."""
    protocol = MarlinProtocol()
    protocol.load(job, first, first)
    protocol.held = False
    protocol.go(0.0)
    assert protocol.take_output() == frame(first + 1, job[first])
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


# --- late oks: none is taken as the answer to a later line
JOB_LATE_OKS = [b"G1 X%d" % k for k in range(1, 41)]


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
    protocol = started(JOB_LATE_OKS, 30)
    token = token_of(silent_then_taken(protocol, 31), protocol)
    assert protocol.lines_done == 31  # it is taken, as the printer says
    assert not protocol.feed(b"ok\n", 3.2)  # line 31's, 0.57 s later
    assert protocol.take_output() == b""
    protocol.feed(echo_of(token), 3.3)
    assert protocol.take_output() == b""
    protocol.feed(b"ok\n", 3.3)
    assert protocol.take_output() == frame(token.number + 1, JOB_LATE_OKS[31])


def test_several_oks_that_come_in_one_read_move_nothing_forward():
    protocol = started(JOB_LATE_OKS, 30)
    token = token_of(silent_then_taken(protocol, 31), protocol)
    assert protocol.feed(b"ok\nok\nok\n", 3.0) == []
    assert protocol.take_output() == b""
    events = protocol.feed(echo_of(token) + b"ok\n", 3.1)
    assert [type(event) for event in events] == [StrayOk]  # two oks belong to no line
    assert protocol.take_output() == b""
    assert protocol.held


def test_slow_board_is_asked_again_within_two_seconds_and_waited_for():
    """Taken, and its echo not back: no more tokens than the board's queue has room for."""
    protocol = started(JOB_LATE_OKS, 30)
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


# --- interpretation of a real Marlin's replies, and framing of lines to it
@pytest.mark.parametrize(
    ("text", "kind", "number"),
    [
        (b"ok", Kind.OK, -1),
        (b"ok T:-15.00 /0.00 B:-15.00 /0.00 @:0 B@:0", Kind.OK, -1),
        (b"ok N18 P0 B0", Kind.OK, 18),
        (b"ok P15 B3", Kind.OK, -1),
        (b"okok", Kind.JUNK, -1),
        (b"oj", Kind.JUNK, -1),
        (b"Resend: 25", Kind.RESEND, 25),
        (b"Resend: 2?", Kind.TEXT, -1),
        (b"Error:checksum mismatch, Last Line: 24", Kind.ERROR, 24),
        (b"Error:MINTEMP triggered, system stopped! Heater_ID: E0", Kind.FAULT, -1),
        (b"Error:Printer halted. kill() called!", Kind.HALT, -1),
        (b"echo:busy: processing", Kind.BUSY, -1),
        (b"echo:busy: paused for user", Kind.BUSY, -1),
        (b'echo:Unknown command: "\x80\xff\x01G1"', Kind.UNKNOWN_COMMAND, -1),
        (b"echo: cold extrusion prevented", Kind.REFUSAL, -1),
        (b"//action:notification Settings Stored", Kind.ACTION, -1),
        (b"start", Kind.START, -1),
        (b"Marlin bugfix-2.1.x", Kind.START, -1),
        (b"wait", Kind.WAIT, -1),
        (b" T:-15.00 /0.00 B:-15.00 /0.00 @:0 B@:0", Kind.REPORT, -1),
        (b"X:0.00 Y:0.00 Z:0.00 E:5.00 Count X:800 Y:0 Z:0", Kind.REPORT, -1),
        (b"  M92 X80.00 Y80.00 Z400.00 E500.00", Kind.TEXT, -1),
    ],
)
def test_recorded_forms(text, kind, number):
    reply = classify(text)
    assert (reply.kind, reply.number) == (kind, number)


@given(st.binary(max_size=80))
def test_any_bytes_are_classified(text):
    assert classify(text).text == text


@given(st.integers(0, 7), st.integers(0, 1))
def test_a_garbled_ok_is_never_an_ok(bit, place):
    text = bytearray(b"ok")
    text[place] ^= 1 << bit
    assert classify(bytes(text)).kind is not Kind.OK


# --- sent lines: no single flipped bit turns one into a stop code
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


def written_in_a_print() -> list[bytes]:
    """All lines of a print with a pause, renumbering apart, which comes before any move."""
    job = b"\n".join([b"M104 S37", b"M400", b"M114", *zigzag(20)])
    bench = Bench(job)
    bench.on_line(9, pause)
    bench.when(LinkState.PAUSED, resume)
    assert bench.run().state is LinkState.DONE
    lines = {line + b"\n" for line in b"".join(bench.sent).split(b"\n") if line}
    return sorted(lines - {RENUMBER.strip() + b"\n"})


def test_no_flipped_bit_makes_a_stop_or_a_renumbering_of_what_is_sent():
    lines = written_in_a_print()
    assert QUESTION.strip() + b"\n" in lines
    for line in lines:
        for garbled in flipped(line):
            assert not {b"112", b"410"}.intersection(seen_by_the_emergency_parser(garbled)), garbled
            assert b"M110" not in garbled


# --- invalid ADVANCED_OK fields: treated as a plain ok, reported once
FACTS = PRINTER.model_copy(update={"advanced_ok": True})


class Lying(SimTransport):
    """Rewrites each answer."""

    def __init__(self, pattern: bytes, by: bytes) -> None:
        super().__init__(MarlinPrinter(FACTS, START), VirtualClock())
        self._pattern, self._by, self._rest = re.compile(pattern), by, b""

    def read(self, timeout: float) -> bytes:
        whole, end, self._rest = (self._rest + super().read(timeout)).rpartition(b"\n")
        return self._pattern.sub(self._by, whole + end)


def told_odd(folder: Path) -> list[str]:
    texts = [r["text"] for r in read_records(folder / "journal.log") if r and r["t"] == "notice"]
    return [text for text in texts if "ADVANCED_OK" in text]


@pytest.mark.parametrize(
    "room",
    [b"P99 B99", b"P0 B0", b"P-1 B999999999999999999999", b"P1.5 B0.25", b"P-3 B-3", b"P7 B2"],
)
def test_room_that_lies_costs_nothing(tmp_path, room):
    transport = Lying(rb"P\d+ B\d+", room)
    status, _ = printed(gcode(100), tmp_path, transport)
    assert status.state is LinkState.DONE
    assert status.line_errors == status.alarms == 0
    assert len(told_odd(tmp_path)) == (room.startswith((b"P-", b"P1.")))
    assert transport.clock.now() < 60


# --- two lines in flight: which pairs are sent together, and recovery from doubt
MOVES = [b"G1 X%d E%d" % (k, k) for k in range(8)]


def pair(number: int) -> bytes:
    return frame(number, MOVES[number - 1]) + frame(number + 1, MOVES[number])


def pairs(job=MOVES, buffer_bytes: int = 128, withholds: bool = False) -> MarlinProtocol:
    protocol = MarlinProtocol(Timing(calm_lines=0), Pairing(buffer_bytes, withholds))
    protocol.load(job, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    return protocol


def refusal(last: int, why: bytes = b"Line Number is not Last Line Number+1") -> bytes:
    return b"Error:%b, Last Line: %d\nResend: %d\nok\n" % (why, last, last + 1)


def in_doubt(protocol: MarlinProtocol, last: int, now: float = 1.0) -> list:
    """Let the protocol ask, and answer."""
    protocol.tick(now + 0.051)
    assert protocol.take_output() == QUESTION
    events = list(protocol.feed(refusal(last), now + 0.06))
    return [*events, *protocol.tick(now + 0.12)]


def test_two_moves_leave_in_one_write_and_the_next_two_after_both_oks():
    protocol = pairs()
    assert protocol.take_output() == pair(1)
    protocol.feed(b"ok\n", 0.1)
    assert (protocol.take_output(), protocol.lines_done) == (b"", 1)
    protocol.feed(b"ok\n", 0.2)
    assert (protocol.take_output(), protocol.lines_done) == (pair(3), 2)
    protocol.feed(b"ok\nok\n", 0.3)
    assert (protocol.take_output(), protocol.lines_done) == (pair(5), 4)


@pytest.mark.parametrize("odd", [b"G4 S1", b"M17", b"G1 X1 E1 M1", b"G28", b"G92 E0", b"G2 X1 I1"])
def test_what_isnt_a_plain_move_flies_alone(odd):
    protocol = pairs([MOVES[0], odd, MOVES[1]])
    assert protocol.take_output() == frame(1, MOVES[0])
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == frame(2, odd)


def test_pair_that_would_overfill_the_receive_buffer_leaves_one_by_one():
    long = [b"G1 X123.456 Y123.456 Z12.345 E12.%05d F12000" % k for k in range(4)]
    assert len(frame(1, long[0]) + frame(2, long[1])) == 104  # and 25 that may follow
    assert pairs(long).take_output() == frame(1, long[0])
    assert pairs(long, buffer_bytes=256).take_output() == frame(1, long[0]) + frame(2, long[1])


def test_tail_of_the_second_that_was_run_holds_the_job():
    protocol = pairs()
    protocol.take_output()
    protocol.feed(refusal(0, b"checksum mismatch") + b"ok\n", 1.0)  # "G1 X1 E1*..." was run
    assert in_doubt(protocol, 0) == [StrayOk(1, line=2)]
    assert protocol.held
    assert protocol.take_output() == b""


def test_profile_chooses_and_families_without_a_count_refuse(tmp_path):
    facts = load(Printer, "generic_marlin")
    assert protocol_for(facts, 0.05).state.pairing is None
    slow = {"lines_in_flight": 2, "host_turnaround_s": 0.016}
    two = protocol_for(facts.model_copy(update=slow), 0.25)
    assert (two.state.pairing, two.timing.quiet_s) == (Pairing(128), 0.25)
    klipper = load(Printer, "klipper_bioprinter")
    assert isinstance(protocol_for(klipper, 0.05), KlipperProtocol)
    path = tmp_path / "two.yaml"
    path.write_text(klipper.model_copy(update={"lines_in_flight": 2}).model_dump_json())
    with pytest.raises(ProfileError, match="lines_in_flight 2: klipper keeps no count"):
        load(Printer, str(path))


@pytest.mark.parametrize(
    ("withholds", "noise", "delay", "seed"),
    [*first_rows([(False, 0.0004, 0.002, seed) for seed in range(6)], 2),
     *first_rows([(True, 0.0006, 0.0003, seed) for seed in range(8)], 2)],
)  # fmt: skip
def test_noisy_print_with_two_lines_in_flight_is_exact(tmp_path, withholds, noise, delay, seed):
    transport = wire(seed=seed, noise=noise, drop_ok=0.002, delay=delay)
    pairing = Pairing(PRINTER.receive_buffer_bytes, withholds)
    data, protocol = gcode(400), MarlinProtocol(Timing(calm_lines=0), pairing)
    status = wired(transport, tmp_path, data, protocol=protocol).run()
    assert status.state is LinkState.DONE, status
    assert same_motion(transport.printer.executed(), foreseen(data))


# --- line sent without its end: executed only once the end follows, else refused
def text(number: int) -> bytes:
    return frame(number, MOVES[number - 1])[:-2]


def end(number: int) -> bytes:
    return frame(number, MOVES[number - 1])[-2:]


def test_each_ok_sends_the_end_of_one_line_and_the_text_of_the_next():
    protocol = pairs(withholds=True)
    assert protocol.take_output() == frame(1, MOVES[0]) + text(2)
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == end(2) + text(3)
    protocol.feed(b"ok\n", 0.2)
    assert (protocol.take_output(), protocol.lines_done) == (end(3) + text(4), 2)


def test_no_line_is_whole_before_the_one_before_it_was_answered():
    printer, protocol = FakeMarlin(), pairs(withholds=True)
    for _ in MOVES:
        said = printer.receive(protocol.take_output())
        assert said == b"ok\n"
        assert len(printer.numbered) == protocol.lines_done + 1
        protocol.feed(said, 0.1)
    assert printer.numbered == [line.decode() for line in MOVES]


def test_a_foreign_line_end_has_the_printer_refuse_a_line_without_its_end():
    pairing = Pairing(128, withholds=True)
    lines = [frame(number, b"G1 X%d F%d" % (number, 7 * number)) for number in range(1, 2000)]
    for number, line in enumerate(lines, 1):
        printer, count = FakeMarlin(), pairing.withheld(line)
        printer.last = number - 1
        said = printer.receive(line[: len(line) - count] + b"\n") if count else b""
        assert printer.executed == []
        assert said.startswith(b"Error") == bool(count)
    whole = [line for line in lines if not pairing.withheld(line)]
    assert 0 < len(whole) < 100
    assert all(line.endswith(b"*0\n") for line in whole)


@pytest.mark.parametrize("said", [b"echo: cold extrusion prevented\nok\n", b"Error:hot\nok\n"])
def test_behind_an_error_the_second_line_is_refused_not_run(said):
    protocol, printer = pairs(withholds=True), FakeMarlin()
    printer.receive(protocol.take_output())
    events = list(protocol.feed(said, 0.1))
    now = 0.1
    for _ in range(12):
        now = max(now, protocol.deadline if protocol.deadline < 99 else now) + 0.001
        events += protocol.tick(now)
        events += protocol.feed(printer.receive(protocol.take_output()), now)
    assert sum(isinstance(event, Fault) for event in events) == 1
    assert printer.numbered == [MOVES[0].decode()]
    assert protocol.held
    protocol.held = False
    protocol.go(now)
    for _ in range(60):
        events += protocol.feed(printer.receive(protocol.take_output()), now)
        now += 0.01
        events += protocol.tick(now)
    assert printer.numbered == [line.decode() for line in MOVES]
    assert not any(isinstance(event, StrayOk) for event in events)


def test_profile_chooses_by_how_soon_answers_come():
    facts = load(Printer, "generic_marlin")
    two = facts.model_copy(update={"lines_in_flight": 2, "baud": 115_200})
    assert protocol_for(two, 0.05).state.pairing == Pairing(128, withholds=True)
    slow = two.model_copy(update={"host_turnaround_s": 0.016})
    assert protocol_for(slow, 0.05).state.pairing == Pairing(128)
