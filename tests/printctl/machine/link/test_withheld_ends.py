"""Line sent without its end: executed only once the end follows, else refused."""

from __future__ import annotations

import re

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.link_protocol import Fault, StrayOk, Timing
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
from tests.printctl.machine.link.fake_marlin import FakeMarlin
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.slower import first_of

JOB = [b"G1 X%d E%d" % (k, k) for k in range(8)]
HARMFUL = re.compile(rb"\s*(G|M|T)\d")


def text(number: int) -> bytes:
    return frame(number, JOB[number - 1])[:-2]


def end(number: int) -> bytes:
    return frame(number, JOB[number - 1])[-2:]


def started(job=JOB, **timing: float) -> MarlinProtocol:
    protocol = MarlinProtocol(Timing(**{"calm_lines": 0, **timing}), Pairing(128, withholds=True))
    protocol.load(job, 0, 0)
    protocol.held = False
    protocol.go(0.0)
    return protocol


def test_each_ok_sends_the_end_of_one_line_and_the_text_of_the_next():
    protocol = started()
    assert protocol.take_output() == frame(1, JOB[0]) + text(2)
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == end(2) + text(3)
    protocol.feed(b"ok\n", 0.2)
    assert (protocol.take_output(), protocol.lines_done) == (end(3) + text(4), 2)


def test_no_line_is_whole_before_the_one_before_it_was_answered():
    printer, protocol = FakeMarlin(), started()
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


def test_letters_of_the_next_command_are_in_the_buffer_before_a_refusal_is_said():
    """Marlin empties its buffer behind the words; what it cuts off must not begin a command."""
    protocol = started()
    protocol.take_output()
    for _ in range(5):
        protocol.feed(b"ok\n", 0.1)
        sent = protocol.take_output()
        whole, words = sent.index(b"\n") + 1, len(b"Error:checksum mismatch, Last Line: 1")
        cuts = [cut for cut in range(whole, len(sent)) if HARMFUL.match(sent[cut:])]
        assert cuts
        assert max(cuts) - whole < words - 20


def test_a_pause_lets_the_second_line_go_and_no_third():
    protocol = started()
    protocol.take_output()
    protocol.held = True
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == end(2)
    assert not protocol.idle
    protocol.feed(b"ok\n", 0.2)
    assert (protocol.take_output(), protocol.lines_done, protocol.idle) == (b"", 2, True)


def test_control_command_goes_behind_the_second():
    protocol = started()
    protocol.take_output()
    protocol.submit(b"M105", 0.05)
    protocol.feed(b"ok\n", 0.1)
    assert protocol.take_output() == end(2)
    protocol.feed(b"ok\n", 0.2)
    assert protocol.take_output() == frame(3, b"M105")


@pytest.mark.parametrize("said", [b"echo: cold extrusion prevented\nok\n", b"Error:hot\nok\n"])
def test_behind_an_error_the_second_line_is_refused_not_run(said):
    protocol, printer = started(), FakeMarlin()
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


def test_answer_of_nobodys_line_has_the_second_refused_too():
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok N1 P15 B3\n", 0.1)
    assert protocol.take_output() == end(2) + text(3)
    assert protocol.feed(b"ok P15 B3\n", 0.2) == [StrayOk(1, 1)]
    protocol.feed(b"ok N2 P15 B3\n", 0.3)
    assert protocol.take_output() == b"\n"


def test_a_cut_answer_lets_nothing_go_before_it_is_whole():
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok\nT:21", 0.1)
    assert (protocol.take_output(), protocol.idle) == (b"", False)
    protocol.feed(b".0 /0.0\n", 0.11)
    assert protocol.take_output() == end(2) + text(3)


@pytest.mark.parametrize("cut", [1, 6, 40])
def test_a_line_that_noise_has_ended_is_sent_again(cut):
    """Its `*` became a line end, and a read has cut the printer's refusal."""
    protocol = started(calm_lines=3)
    protocol.take_output()
    said = b"Error:No Checksum with line number, Last Line: 1\nResend: 2\nok\n"
    assert not protocol.feed(b"ok\n" + said[:cut], 0.1)
    assert not protocol.feed(said[cut:], 0.11)
    assert protocol.take_output() == b"\n"
    protocol.tick(0.2)
    assert protocol.take_output() == QUESTION
    protocol.feed(
        b"Error:Line Number is not Last Line Number+1, Last Line: 1\nResend: 2\nok\n", 0.21
    )
    assert not any(isinstance(event, (Fault, StrayOk)) for event in protocol.tick(0.3))
    assert protocol.take_output() == frame(2, JOB[1])


def test_behind_a_text_that_is_never_ended_the_second_is_refused_and_a_token_sent():
    protocol = started()
    protocol.take_output()
    protocol.feed(b"ok\nT:21", 0.1)
    protocol.tick(protocol.deadline)
    assert re.match(rb"\nN2 M0?118 E1 at 2\.1\*", protocol.take_output())


def test_stop_past_the_line_in_flight_lets_the_second_go_first():
    protocol = started()
    protocol.take_output()
    protocol.held = True
    assert protocol.cut_in([b"M410"], True, 0.1)
    assert protocol.take_output() == end(2) + b"\nM410\n"


def test_doubt_ends_the_second_before_it_asks():
    protocol = started(calm_lines=3)
    protocol.take_output()
    protocol.feed(b"Error:checksum mismatch, Last Line: 0\nResend: 1\nok\n", 0.1)
    assert protocol.take_output() == b"\n"
    protocol.tick(0.2)
    assert protocol.take_output() == QUESTION
    protocol.feed(
        b"Error:Line Number is not Last Line Number+1, Last Line: 0\nResend: 1\nok\n", 0.21
    )
    protocol.tick(0.3)
    assert protocol.take_output() == frame(1, JOB[0])


def test_profile_chooses_by_how_soon_answers_come():
    facts = load(Printer, "generic_marlin")
    two = facts.model_copy(update={"lines_in_flight": 2, "baud": 115_200})
    assert protocol_for(two, 0.05).state.pairing == Pairing(128, withholds=True)
    slow = two.model_copy(update={"host_turnaround_s": 0.016})
    assert protocol_for(slow, 0.05).state.pairing == Pairing(128)


@pytest.mark.parametrize("seed", first_of(range(8), 2))
def test_noisy_print_is_exact(tmp_path, seed):
    facts, start = load(Printer, "generic_marlin"), (50.0, 50.0, 10.0)
    moves = [b"G1 X%.3f E%.4f F1800" % (50 + k % 2 * 3.5, 0.0035 * (k + 1)) for k in range(400)]
    data = b"M302 P1\nG90\nM82\nG92 X50 Y50 Z10 E0\n" + b"\n".join(moves) + b"\n"
    printer, clock = MarlinPrinter(facts, start), VirtualClock()
    rng = np.random.default_rng(seed)
    wire = SimTransport(printer, clock, rng, noise=0.0006, drop_ok=0.002, delay=0.0003)
    protocol = MarlinProtocol(Timing(calm_lines=0), Pairing(facts.receive_buffer_bytes, True))
    wiring = Wiring(wire, protocol, clock, Journal(tmp_path / "journal.log"), facts)
    status = Streamer(wiring, parse_job(data, "test.gcode")).run()
    assert status.state is LinkState.DONE, status
    foreseen = dry_run(data, facts, start, cold_extrusion=True).executed
    assert np.array_equal(printer.executed().end, foreseen.end)
    assert np.array_equal(printer.executed().plunger_end, foreseen.plunger_end)
