"""Two lines in flight: which pairs are sent together, and recovery from doubt."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, ProfileError, load
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import Fault, StrayOk, Timing
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.marlin.state import QUESTION
from firmware_profiles.families.pairing import Pairing
from printctl.machine.link.families import protocol_for
from printctl.machine.link.states import LinkState
from tests.printctl.machine.link.fake_marlin import FakeMarlin
from tests.printctl.machine.link.simulated import PRINTER, foreseen, gcode, same_motion, wire, wired
from tests.slower import first_rows

JOB = [b"G1 X%d E%d" % (k, k) for k in range(8)]


def pair(number: int) -> bytes:
    return frame(number, JOB[number - 1]) + frame(number + 1, JOB[number])


def started(job=JOB, buffer_bytes: int = 128, withholds: bool = False) -> MarlinProtocol:
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
    protocol = started()
    assert protocol.take_output() == pair(1)
    protocol.feed(b"ok\n", 0.1)
    assert (protocol.take_output(), protocol.lines_done) == (b"", 1)
    protocol.feed(b"ok\n", 0.2)
    assert (protocol.take_output(), protocol.lines_done) == (pair(3), 2)
    protocol.feed(b"ok\nok\n", 0.3)
    assert (protocol.take_output(), protocol.lines_done) == (pair(5), 4)


@pytest.mark.parametrize("odd", [b"G4 S1", b"M17", b"G1 X1 E1 M1", b"G28", b"G92 E0", b"G2 X1 I1"])
def test_what_isnt_a_plain_move_flies_alone(odd):
    protocol = started([JOB[0], odd, JOB[1]])
    assert protocol.take_output() == frame(1, JOB[0])
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == frame(2, odd)


def test_pair_that_would_overfill_the_receive_buffer_leaves_one_by_one():
    long = [b"G1 X123.456 Y123.456 Z12.345 E12.%05d F12000" % k for k in range(4)]
    assert len(frame(1, long[0]) + frame(2, long[1])) == 104  # and 25 that may follow
    assert started(long).take_output() == frame(1, long[0])
    assert started(long, buffer_bytes=256).take_output() == frame(1, long[0]) + frame(2, long[1])


def test_tail_of_the_second_that_was_run_holds_the_job():
    protocol = started()
    protocol.take_output()
    protocol.feed(refusal(0, b"checksum mismatch") + b"ok\n", 1.0)  # "G1 X1 E1*..." was run
    assert in_doubt(protocol, 0) == [StrayOk(1)]
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
    return frame(number, JOB[number - 1])[:-2]


def end(number: int) -> bytes:
    return frame(number, JOB[number - 1])[-2:]


def test_each_ok_sends_the_end_of_one_line_and_the_text_of_the_next():
    protocol = started(withholds=True)
    assert protocol.take_output() == frame(1, JOB[0]) + text(2)
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == end(2) + text(3)
    protocol.feed(b"ok\n", 0.2)
    assert (protocol.take_output(), protocol.lines_done) == (end(3) + text(4), 2)


def test_no_line_is_whole_before_the_one_before_it_was_answered():
    printer, protocol = FakeMarlin(), started(withholds=True)
    for _ in JOB:
        said = printer.receive(protocol.take_output())
        assert said == b"ok\n"
        assert len(printer.numbered) == protocol.lines_done + 1
        protocol.feed(said, 0.1)
    assert printer.numbered == [line.decode() for line in JOB]


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
    protocol, printer = started(withholds=True), FakeMarlin()
    printer.receive(protocol.take_output())
    events = list(protocol.feed(said, 0.1))
    now = 0.1
    for _ in range(12):
        now = max(now, protocol.deadline if protocol.deadline < 99 else now) + 0.001
        events += protocol.tick(now)
        events += protocol.feed(printer.receive(protocol.take_output()), now)
    assert sum(isinstance(event, Fault) for event in events) == 1
    assert printer.numbered == [JOB[0].decode()]
    assert protocol.held
    protocol.held = False
    protocol.go(now)
    for _ in range(60):
        events += protocol.feed(printer.receive(protocol.take_output()), now)
        now += 0.01
        events += protocol.tick(now)
    assert printer.numbered == [line.decode() for line in JOB]
    assert not any(isinstance(event, StrayOk) for event in events)


def test_profile_chooses_by_how_soon_answers_come():
    facts = load(Printer, "generic_marlin")
    two = facts.model_copy(update={"lines_in_flight": 2, "baud": 115_200})
    assert protocol_for(two, 0.05).state.pairing == Pairing(128, withholds=True)
    slow = two.model_copy(update={"host_turnaround_s": 0.016})
    assert protocol_for(slow, 0.05).state.pairing == Pairing(128)
