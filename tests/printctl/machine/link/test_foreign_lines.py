"""Commands from another program to the printer during a print."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from firmware_profiles import Printer, load
from firmware_profiles.families.link_protocol import StrayOk, Synchronised, Timing
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.marlin.replies import frame
from firmware_profiles.families.pairing import Pairing
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.families import protocol_for
from printctl.machine.link.journal import Journal
from printctl.machine.link.journalled_print import JournalledPrint, read_journal
from printctl.machine.link.ports import PortPrograms
from printctl.machine.link.print_parts import EVERY_S
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from printctl.machine.link.wiring import Wiring
from sim.devices.families.registry import simulated_printer
from tests.printctl.machine.link.fake_marlin import FakeMarlin, FakeTransport, zigzag
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.journals import journal_in
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import START, gcode
from tests.printctl.machine.link.test_streamer import job_of, streamer_of
from tests.slower import first_of

LINES = 60
OTHERS = "another program or noise wrote to this printer: 1 answer more than lines"


class SharedTransport(FakeTransport):
    """Another program writes to the same port as soon as a line with some text has left.

    Each answer is read by itself, as from a slow wire; the other program leaves them to the host.
    """

    def __init__(self, printer: FakeMarlin, clock: VirtualClock, at: bytes, writes: bytes) -> None:
        super().__init__(printer, clock)
        self._at, self._writes = at, writes
        self.each_s = 0.001
        self.foreign_at = self.pairs = 0

    def write(self, data: bytes) -> None:
        super().write(data)
        self.pairs += data.count(b" G1 ") == 2
        if self._at in data and self._writes:
            writes, self._writes = self._writes, b""
            self.waiting += self.printer.receive(writes)
            self.foreign_at = self.printer.last

    def read(self, timeout: float) -> bytes:
        line, end, self.waiting = self.waiting.partition(b"\n")
        self.clock.sleep(self.each_s if line + end else timeout)
        return line + end


def printed(
    tmp_path,
    writes: bytes,
    at: bytes = b" E0.05000 ",
    each_s: float = 0.001,
    count: int = LINES,
    on_status: Callable[[Status], None] | None = None,
) -> tuple[Status, JournalledPrint, SharedTransport]:
    transport = SharedTransport(FakeMarlin(), VirtualClock(), at, writes)
    transport.each_s = each_s
    streamer = streamer_of(
        job_of([b"G1 Z0.5 F300", *zigzag(count)]), transport, tmp_path, on_status
    )
    status = streamer.run()
    return status, read_journal(tmp_path / "journal.log"), transport


def test_move_that_another_program_writes_is_told_at_the_end(tmp_path):
    status, history, _ = printed(tmp_path, b"G1 X150 F6000\n")
    assert status.state is LinkState.DONE
    assert OTHERS in status.message
    assert not status.position_known
    assert status.alarms == 1
    assert OTHERS in history.alarms[0]


def test_needle_that_another_program_has_lifted_ends_the_print(tmp_path):
    status, history, _ = printed(tmp_path, b"G1 Z60 F600\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "Z is 60" in status.message
    assert OTHERS in status.message
    assert OTHERS in history.alarms[0]


@pytest.mark.parametrize("place", [b"X0", b"Y-3 X20"])
def test_place_that_another_program_has_renamed_ends_the_print(tmp_path, place):
    status, history, _ = printed(tmp_path, b"G92 " + place + b"\n")
    assert status.state is LinkState.POSITION_UNKNOWN
    assert f"{place[:1].decode()} is called" in status.message
    assert OTHERS in history.alarms[0]


def test_place_renamed_without_an_answer_that_is_noticed_ends_the_print(tmp_path):
    class Swallowed(SharedTransport):
        def write(self, data: bytes) -> None:
            before = self._writes
            super().write(data)
            if before and not self._writes:  # as in a doubt, whose answers are drained
                self.waiting = self.waiting[: self.waiting.rindex(b"X:")]

    transport = Swallowed(FakeMarlin(), VirtualClock(), b" E0.05000 ", b"G92 X1\n")
    status = streamer_of(job_of(zigzag(LINES)), transport, tmp_path).run()
    assert not transport._writes
    assert status.state is LinkState.POSITION_UNKNOWN
    assert "X is called" in status.message


def test_lines_are_counted_by_the_journal_as_by_the_printer(tmp_path):
    status, history, transport = printed(tmp_path, b"M105\n", each_s=0.05, count=600)
    assert status.state is LinkState.DONE
    assert history.frame["offset"].keys() == set("XYZ")
    assert history.job_line(transport.printer.last) == status.lines_total


def test_surplus_answer_is_noticed_soon_in_a_long_print(tmp_path):
    status, _, transport = printed(tmp_path, b"G1 Z60 F600\n", each_s=0.05, count=600)
    assert status.state is LinkState.POSITION_UNKNOWN
    assert status.lines_done < transport.foreign_at + EVERY_S / 0.05 + 5


def test_move_between_two_lines_of_a_pause_is_told(tmp_path):
    said: list[str] = []

    def on_status(status: Status) -> None:
        said.append(status.state)

    class Paused(SharedTransport):
        def read(self, timeout: float) -> bytes:
            if said and said[-1] == "paused" and self._writes:
                self.waiting += self.printer.receive(self._writes)
                self._writes = b""
                streamer.resume()
            return super().read(timeout)

    transport = Paused(FakeMarlin(), VirtualClock(), b"nothing", b"M105\n")
    streamer = streamer_of(job_of([b"G1 Z0.5 F300", *zigzag(20)]), transport, tmp_path, on_status)
    streamer.pause()
    status = streamer.run()
    assert status.state is LinkState.DONE
    assert OTHERS in status.message


def test_surplus_answer_is_noticed_with_two_lines_in_flight(tmp_path):
    clock, said = VirtualClock(), MarlinProtocol(Timing(calm_lines=0), Pairing(128))
    transport = SharedTransport(FakeMarlin(), clock, b" E0.05000 ", b"G1 X150 F6000\n")
    wiring = Wiring(
        transport=transport,
        protocol=said,
        clock=clock,
        journal=Journal(tmp_path / "journal.log"),
        printer=load(Printer, "generic_marlin"),
        on_status=lambda status: streamer.resume() if status.state is LinkState.PAUSED else None,
    )
    streamer = Streamer(wiring, job_of(zigzag(LINES)))
    status = streamer.run()
    assert transport.pairs
    assert status.state is LinkState.DONE
    assert OTHERS in status.message


def test_clean_print_of_minutes_tells_of_nobody(tmp_path):
    status, history, _ = printed(tmp_path, b"", each_s=0.1, count=1500)
    assert status.message == f"all {status.lines_total} lines done; the plunger isn't compared"
    assert history.alarms == []


@pytest.mark.parametrize("noise", first_of([0.001, 0.0004]))
def test_noise_is_not_taken_for_another_program(tmp_path, noise):
    printer, rng = FakeMarlin(np.random.default_rng(2)), np.random.default_rng(1)
    transport = FakeTransport(printer, VirtualClock(), rng, noise=noise, drop_ok=0.002)
    status = streamer_of(job_of(zigzag(1500)), transport, tmp_path).run()
    assert status.state is LinkState.DONE
    assert status.line_errors > 5
    assert not any(
        "another program" in text for text in read_journal(tmp_path / "journal.log").alarms
    )


@pytest.mark.parametrize("complete", [True, False])
def test_missing_answers_on_a_clean_wire_are_told_as_perhaps_read(tmp_path, complete):
    class Robbed(FakeTransport):
        def programs(self) -> PortPrograms:
            return PortPrograms(complete=complete)

    transport = Robbed(FakeMarlin(), VirtualClock(), np.random.default_rng(1), drop_ok=0.02)
    status = streamer_of(job_of(zigzag(200)), transport, tmp_path).run()
    alarms = read_journal(tmp_path / "journal.log").alarms
    assert status.state is LinkState.DONE
    assert any("another program may read this port" in text for text in alarms) is not complete


def started(sent: int = 30) -> MarlinProtocol:
    protocol = MarlinProtocol()
    protocol.load(zigzag(100), sent, sent)
    protocol.held = False
    protocol.go(0.0)
    protocol.take_output()
    return protocol


def test_answer_that_names_no_line_is_noticed_at_once_where_each_is_named():
    protocol = started()
    protocol.feed(b"ok N31 P15 B3\n", 0.1)
    assert protocol.take_output() == frame(32, zigzag(100)[31])
    protocol.feed(b"ok P", 0.15)
    assert protocol.feed(b"15 B3\n", 0.2) == [StrayOk(31, 1)]
    assert not protocol.tick(1.0)
    assert protocol.take_output() == b""
    assert not protocol.feed(b"ok N32 P15 B3\n", 0.3)
    assert protocol.idle
    assert protocol.held


def test_ok_with_nothing_in_flight_is_one_more_than_lines():
    protocol = started()
    protocol.held = True
    protocol.feed(b"ok\n", 0.1)
    assert protocol.idle
    assert protocol.feed(b"ok\n", 0.2) == [StrayOk(31, 1)]


def test_second_ok_that_names_our_own_line_is_nobody_elses():
    """Seen on a real board: a token run twice, behind M410 without emergency parser."""
    protocol = started()
    protocol.held = True
    protocol.feed(b"ok N31 P15 B3\n", 0.1)
    assert protocol.feed(b"ok N31 P15 B3\n", 0.2) == [StrayOk(31, 0)]


@pytest.mark.parametrize("oks", [1, 2])
def test_each_ok_before_the_echo_is_one_more_than_lines(oks):
    protocol = started()
    protocol.held = True
    protocol.feed(b"ok\n", 0.1)
    protocol.confirm(0.2)
    protocol.tick(0.2)
    token = re.search(rb"at \d+\.\d+", protocol.take_output())
    assert token
    events = protocol.feed(b"ok\n" * oks + b"echo:" + token[0] + b"\nok\n", 0.3)
    assert events == [StrayOk(32, oks), Synchronised(32)]


@pytest.mark.parametrize(
    ("profile", "head"),
    [
        ("klipper_bioprinter", b"SET_KINEMATIC_POSITION X=50 Y=50 Z=10\n"),
        ("ender5_duet3_replistruder5", b"M302 P1\n"),
    ],
)
def test_another_program_s_line_on_other_boards_pauses_once_and_is_told(tmp_path, profile, head):
    facts, states = load(Printer, profile), list[LinkState]()

    class Meddled(SimTransport):
        writes = b"M105\n"

        def write(self, data: bytes) -> None:
            super().write(data)
            if b" E0.2" in data and self.writes:
                super().write(self.writes)
                self.writes = b""

    def on_status(status: Status) -> None:
        if status.state is LinkState.PAUSED:
            streamer.resume()
        states.append(status.state)

    data = head + b"G90\nM82\n" + gcode(200).split(b"\n", 4)[4]
    wire = Meddled(simulated_printer(facts)(facts, START), VirtualClock())
    protocol, journal = protocol_for(facts, 0.05), journal_in(tmp_path)
    wiring = Wiring(wire, protocol, wire.clock, journal, facts, on_status=on_status)
    streamer = Streamer(wiring, parse_job(data, "test.gcode", facts))
    status = streamer.run()
    assert (status.state, status.position_known) == (LinkState.DONE, False), status
    assert states.count(LinkState.PAUSED) == 1
    assert OTHERS in status.message
