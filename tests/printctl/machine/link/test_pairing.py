"""Two lines in flight: which pairs are sent together, and recovery from doubt."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Printer, ProfileError, load
from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import (
    Fault,
    LinesResent,
    Notice,
    StrayOk,
    Timing,
    TokenSent,
)
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.marlin.state import QUESTION
from firmware_profiles.families.pairing import Pairing
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.families import protocol_for
from printctl.machine.link.journal import Journal
from printctl.machine.link.states import LinkState
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.wiring import Wiring
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.slower import first_of

JOB = [b"G1 X%d E%d" % (k, k) for k in range(8)]


def pair(number: int) -> bytes:
    return frame(number, JOB[number - 1]) + frame(number + 1, JOB[number])


def started(job=JOB, buffer_bytes: int = 128, **timing: float) -> MarlinProtocol:
    protocol = MarlinProtocol(Timing(**{"calm_lines": 0, **timing}), Pairing(buffer_bytes))
    protocol.load(job, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    return protocol


def refusal(last: int, why: bytes = b"Line Number is not Last Line Number+1") -> bytes:
    return b"Error:%b, Last Line: %d\nResend: %d\nok\n" % (why, last, last + 1)


def echo(protocol: MarlinProtocol, number: int, now: float) -> None:
    """Have the token that was sent as line ``number`` come back, and answer it."""
    said = protocol.take_output()
    text = b"at %d." % number
    assert said.startswith(b"N%d M0118 E1 %b" % (number, text))
    protocol.feed(b"echo:%b1\nok\n" % text, now)


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


def test_first_refused_sends_both_again_one_by_one():
    protocol = started(calm_lines=3)
    protocol.take_output()
    protocol.feed(refusal(0, b"checksum mismatch") + refusal(0), 1.0)
    in_doubt(protocol, 0)
    assert protocol.take_output() == frame(1, JOB[0])
    protocol.feed(b"ok\n", 2.0)
    echo(protocol, 2, 2.0)
    assert protocol.take_output() == frame(3, JOB[1])
    protocol.feed(b"ok\n", 2.1)
    assert protocol.take_output() == frame(4, JOB[2]) + frame(5, JOB[3])
    assert (protocol.lines_done, protocol.line_errors) == (2, 1)


def test_second_refused_is_sent_again_after_the_ok_to_the_first():
    protocol = started()
    protocol.take_output()
    protocol.feed(refusal(1, b"checksum mismatch"), 1.0)
    in_doubt(protocol, 1)
    protocol.feed(b"ok\n", 2.0)  # the first waited for its place in the planner
    echo(protocol, 2, 2.1)
    assert protocol.take_output() == frame(3, JOB[1]) + frame(4, JOB[2])


def test_garbled_refusal_of_the_second_is_no_fault_of_the_first():
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok\n", 0.5)
    protocol.feed(b"Error:checks5m mismatch, Last Linez 1\nResend: 2\nok\n", 1.0)
    assert in_doubt(protocol, 1) == []
    assert protocol.take_output() == frame(2, JOB[1])
    protocol = started()
    protocol.take_output()
    protocol.feed(b"Error:checks5m mismatch, Last Linez 1\nResend: 2\nok\n", 1.0)
    assert not any(isinstance(event, Fault) for event in in_doubt(protocol, 1))
    protocol.feed(b"ok\n", 1.5)
    echo(protocol, 2, 1.6)
    assert protocol.take_output() == frame(3, JOB[1]) + frame(4, JOB[2])


@pytest.mark.parametrize("heard", [0, 1])
def test_both_taken_is_waited_for_whatever_oks_were_heard(heard):
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok\n" * heard, 0.9)
    protocol.feed(b"echo:b\x00sy\n", 1.0)
    in_doubt(protocol, 2)
    assert protocol.lines_done == 2
    protocol.feed(b"ok\n" * (2 - heard), 2.0)
    echo(protocol, 3, 2.1)
    assert protocol.take_output() == frame(4, JOB[2]) + frame(5, JOB[3])
    assert not protocol.held


def test_silence_behind_two_lines_that_were_taken_counts_both():
    protocol = started()
    protocol.take_output()
    protocol.tick(2.6)
    assert protocol.take_output() == QUESTION
    protocol.feed(refusal(2), 2.7)
    assert {type(event) for event in protocol.tick(2.8)} == {Notice, TokenSent}
    assert protocol.lines_done == 2
    echo(protocol, 3, 2.9)
    assert protocol.take_output() == frame(4, JOB[2]) + frame(5, JOB[3])


def test_advanced_ok_to_the_second_counts_both():
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok N2 P15 B3\n", 1.0)
    in_doubt(protocol, 2)
    echo(protocol, 3, 2.0)
    assert protocol.take_output() == frame(4, JOB[2]) + frame(5, JOB[3])


def test_tail_of_the_second_that_was_run_holds_the_job():
    protocol = started()
    protocol.take_output()
    protocol.feed(refusal(0, b"checksum mismatch") + b"ok\n", 1.0)  # "G1 X1 E1*..." was run
    assert in_doubt(protocol, 0) == [StrayOk(1)]
    assert protocol.held
    assert protocol.take_output() == b""


def test_belief_that_ran_ahead_is_taken_back_with_both():
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok\nok\n", 0.5)
    assert protocol.take_output() == pair(3)
    protocol.feed(refusal(1), 1.0)
    assert in_doubt(protocol, 1) == []
    assert in_doubt(protocol, 1, 1.2) == [LinesResent(2, 2)]
    protocol.held = False
    protocol.go(2.0)
    assert protocol.take_output() == frame(2, JOB[1])


def test_control_command_flies_alone_after_both():
    protocol = started()
    protocol.take_output()
    protocol.submit(b"M105", 0.1)
    protocol.feed(b"ok\n", 0.2)
    assert protocol.take_output() == b""
    protocol.feed(b"ok\n", 0.3)
    assert protocol.take_output() == frame(3, b"M105")


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


@pytest.mark.parametrize("seed", first_of(range(6), 2))
def test_noisy_print_in_pairs_is_exact(tmp_path, seed):
    facts, start = load(Printer, "generic_marlin"), (50.0, 50.0, 10.0)
    moves = [b"G1 X%.3f E%.4f F1800" % (50 + k % 2 * 3.5, 0.0035 * (k + 1)) for k in range(400)]
    data = b"M302 P1\nG90\nM82\nG92 X50 Y50 Z10 E0\n" + b"\n".join(moves) + b"\n"
    printer, clock = MarlinPrinter(facts, start), VirtualClock()
    rng = np.random.default_rng(seed)
    wire = SimTransport(printer, clock, rng, noise=0.0004, drop_ok=0.002, delay=0.002)
    protocol = MarlinProtocol(Timing(calm_lines=0), Pairing(facts.receive_buffer_bytes))
    wiring = Wiring(wire, protocol, clock, Journal(tmp_path / "journal.log"), facts)
    status = Streamer(wiring, parse_job(data, "test.gcode")).run()
    assert status.state is LinkState.DONE, status
    foreseen = dry_run(data, facts, start, cold_extrusion=True).executed
    assert np.array_equal(printer.executed().end, foreseen.end)
    assert np.array_equal(printer.executed().plunger_end, foreseen.plunger_end)
