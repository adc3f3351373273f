"""Marlin's link protocol, property-based: no line lost, doubled or swapped by noise."""

from __future__ import annotations

from collections import deque
from functools import partial
from itertools import groupby

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.link_protocol import (
    FirmwareReset,
    LinesResent,
    LostSynchronisation,
    NoReply,
    StrayOk,
    Synchronised,
)
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from firmware_profiles.families.reprapfirmware.facts import RrfProtocol
from firmware_profiles.families.timing import Timing
from printctl.machine.job.coordinates import places
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.fake_marlin import FakeMarlin, slips_through, zigzag
from tests.slower import examples

QUEUE = 4


class QueueingMarlin(FakeMarlin):
    """`receive` takes lines, `work` carries them out."""

    def __init__(self, rng=None) -> None:
        super().__init__(rng)
        self.queue: deque[str] = deque()

    def receive(self, data: bytes) -> bytes:
        self._rest += data
        out = b""
        while b"\n" in self._rest and len(self.queue) < QUEUE:
            line, self._rest = self._rest.split(b"\n", 1)
            if line.strip() and not self.halted:
                out += self._take(line.decode("latin-1").strip())
        return out

    def work(self, count: int) -> bytes:
        """Carry out up to ``count`` commands; give the answers to them and to what is read then."""
        out = b""
        for _ in range(min(count, len(self.queue))):
            out += super()._do(self.queue.popleft())
        return out + self.receive(b"")

    def _do(self, command: str) -> bytes:
        self.queue.append(command)
        return b""


LINES = zigzag(60)
FILE = [line.decode() for line in LINES]
MANUAL = "M105"


class WireMachine(RuleBasedStateMachine):
    """A printer, its protocol and the bytes on their way between them.

    A subclass makes both, says which noise its check would find, and what was taken.
    """

    noisy = True

    def make_printer(self, seed: int):
        raise NotImplementedError

    def make_protocol(self):
        raise NotImplementedError

    def found_out(self, garbled: bytes) -> bool:
        """Whether the printer would notice that ``down`` has become this."""
        raise NotImplementedError

    def taken(self) -> list[str]:
        """Lines of the file that the printer executed, in order."""
        raise NotImplementedError

    @initialize(seed=st.integers(0, 2**32 - 1))
    def connect(self, seed: int) -> None:
        self.printer, self.protocol = self.make_printer(seed), self.make_protocol()
        self.now, self.in_step, self.controls = 0.0, 0, 0
        self.down = self.up = b""
        self.over = False
        self.protocol.renumber(self.now)
        self.run_clean(lambda: self.in_step > 0)
        self.protocol.load(LINES, 0, 0)
        self.protocol.held = False
        self.protocol.go(self.now)
        self.flow()

    # --- the wire

    def flow(self) -> None:
        self.down += self.protocol.take_output()

    def note(self, events) -> None:
        for event in events:
            self.over |= isinstance(event, LostSynchronisation | NoReply | FirmwareReset)
            self.in_step += isinstance(event, Synchronised)
            if isinstance(event, LinesResent | StrayOk):
                self.protocol.held = False
                self.protocol.go(self.now)
        self.flow()

    def run_clean(self, done) -> None:
        for _ in range(3000):
            if self.over or done():
                return
            self.flow()
            self.printer_reads()
            if self.up:
                self.host_reads(len(self.up))
            else:
                self.pass_time(0.05)

    def pass_time(self, seconds: float) -> None:
        self.now += seconds
        self.note(self.protocol.tick(self.now))

    # --- what may happen

    @rule()
    def printer_reads(self) -> None:
        self.up += self.printer.receive(self.down)
        self.down = b""

    @rule(count=st.integers(1, 60))
    def host_reads(self, count: int) -> None:
        data, self.up = self.up[:count], self.up[count:]
        if data:
            self.note(self.protocol.feed(data, self.now))

    @rule(times=st.integers(1, 20))
    def all_is_well(self, times: int) -> None:
        for _ in range(times):
            self.printer_reads()
            self.host_reads(1000)

    @rule(seconds=st.sampled_from([0.001, 0.06, 0.3, 1.1, 2.6, 4.1]))
    def time_passes(self, seconds: float) -> None:
        self.printer_reads()
        self.host_reads(1000)
        self.pass_time(seconds)

    @precondition(lambda self: self.noisy and self.down)
    @rule(data=st.data(), bits=st.integers(1, 3))
    def garble_down(self, data, bits: int) -> None:
        garbled = self.flip(self.down, data, bits)
        if self.found_out(garbled):
            self.down = garbled

    @precondition(lambda self: self.noisy and self.up)
    @rule(data=st.data(), bits=st.integers(1, 3))
    def garble_up(self, data, bits: int) -> None:
        self.up = self.flip(self.up, data, bits)

    def flip(self, text: bytes, data, bits: int) -> bytes:
        out = bytearray(text)
        for _ in range(bits):
            place = data.draw(st.integers(0, len(out) - 1))
            out[place] ^= 1 << data.draw(st.integers(0, 7))
        return bytes(out)

    @precondition(lambda self: self.noisy and b"ok" in self.up)
    @rule()
    def lose_an_ok(self) -> None:
        self.up = self.up.replace(b"ok" + self.printer.end.encode(), b"", 1)

    @precondition(lambda self: self.noisy and self.down)
    @rule()
    def lose_a_line(self) -> None:
        self.down = self.down.partition(b"\n")[2]

    @rule()
    def a_manual_command(self) -> None:
        if self.controls < 3 and not self.over:
            self.controls += 1
            self.protocol.submit(MANUAL.encode(), self.now)
            self.flow()

    # --- what must hold

    @invariant()
    def executed_is_a_prefix_of_the_file(self) -> None:
        taken = self.taken()
        assert taken == FILE[: len(taken)]

    def teardown(self) -> None:
        if not hasattr(self, "protocol"):
            return
        for _ in range(4):
            self.run_clean(lambda: self.protocol.idle)
            self.in_step = 0
            if not self.over:
                self.protocol.ask(self.now)
                self.run_clean(lambda: self.in_step > 0)
            self.protocol.go(self.now)
        self.executed_is_a_prefix_of_the_file()
        if not self.over:
            assert self.protocol.lines_done == len(FILE)
            assert self.taken() == FILE


def as_test(machine: type[WireMachine], most: int = 60):
    """The machine's test case, with settings for all of them."""
    case = machine.TestCase
    case.settings = settings(
        max_examples=examples(most),
        stateful_step_count=60,
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    return case


class MarlinWire(WireMachine):
    def make_printer(self, seed: int) -> FakeMarlin:
        return FakeMarlin(np.random.default_rng(seed))

    def make_protocol(self) -> MarlinProtocol:
        return MarlinProtocol()

    def found_out(self, garbled: bytes) -> bool:
        return not slips_through(self.down, garbled)

    def taken(self) -> list[str]:
        return [line for line in self.printer.numbered if line != MANUAL]

    @rule(
        text=st.sampled_from(
            [
                b"echo:busy: processing\n",
                b" T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0\n",
                b"X:10.00 Y:0.00 Z:0.00 E:5.00 Count X:800 Y:0 Z:0\n",
                b"//action:notification hello\n",
                b"echo:Print time: 0s\n",
                b"wait\n",
            ]
        )
    )
    def the_printer_chats(self, text: bytes) -> None:
        if self.up.endswith(b"\n") or not self.up:
            self.up += text


class PairsWire(MarlinWire):
    """Two lines in flight, after a doubt at once again; the flush may cut anywhere."""

    def make_protocol(self) -> MarlinProtocol:
        return MarlinProtocol(Timing(calm_lines=0), Pairing(128))


TestOneInFlight = as_test(MarlinWire)
TestTwoInFlight = as_test(PairsWire, 80)


class LateWire(MarlinWire):
    """Any ok may be late by any time, while questions are answered at once."""

    most = 1

    def make_printer(self, seed: int) -> QueueingMarlin:
        return QueueingMarlin(np.random.default_rng(seed))

    def printer_works(self, count: int) -> None:
        self.up += self.printer.work(count)

    def run_clean(self, done) -> None:
        for _ in range(3000):
            if self.over or done():
                return
            self.flow()
            self.printer_reads()
            self.printer_works(1)
            if self.up:
                self.host_reads(len(self.up))
            else:
                self.pass_time(0.05)

    @rule(times=st.integers(1, 20))
    def all_is_well(self, times: int) -> None:
        for _ in range(times):
            self.printer_reads()
            self.printer_works(4)
            self.host_reads(1000)

    @rule(count=st.integers(1, 4))
    def some_lines_are_carried_out(self, count: int) -> None:
        self.printer_works(count)

    @rule(seconds=st.sampled_from([0.06, 1.1, 2.6, 11.0]))
    def nothing_comes_through(self, seconds: float) -> None:
        self.pass_time(seconds)

    @invariant()
    def no_ok_is_another_lines(self) -> None:
        """With oks believed, all but the lines in flight are carried out."""
        if self.noisy or not hasattr(self, "protocol") or self.protocol.state.tokens.suspect:
            return
        assert len(self.printer.queue) <= self.most

    def teardown(self) -> None:
        super().teardown()
        if hasattr(self, "protocol") and not self.over:
            self.protocol.confirm(self.now)
            self.in_step = 0
            self.run_clean(lambda: self.in_step > 0)
            assert self.over or not self.printer.queue


class LateAlone(LateWire):
    noisy = False


class LatePairs(LateWire):
    noisy = False
    most = 2

    def make_protocol(self) -> MarlinProtocol:
        return MarlinProtocol(Timing(calm_lines=0), Pairing(128))


class LateNoise(LateWire):
    """And noise on top."""


TestLateOks = as_test(LateAlone, 80)
TestLateOksOfPairs = as_test(LatePairs, 80)
TestLateOksAndNoise = as_test(LateNoise, 80)


# --- link protocols of other families, property-based; only noise that their checks detect
class FamilyWire(WireMachine):
    printer_class = FakeDuet
    protocol_class = staticmethod(partial(RrfProtocol, places))
    once = False
    """Whether a line may be executed once only; else again, right after itself, at its end."""

    def make_printer(self, seed: int):
        return self.printer_class()

    def make_protocol(self):
        return self.protocol_class()

    def found_out(self, garbled: bytes) -> bool:
        whole = self.printer._rest + self.down
        meant = {self.printer.accepts(line) for line in whole.split(b"\n")}
        lines = (self.printer._rest + garbled).split(b"\n")
        return all(self.printer.accepts(line) in meant | {None, ""} for line in lines)

    def taken(self) -> list[str]:
        lines = [line for line in self.printer.executed if line in FILE]
        return lines if self.once else [line for line, _ in groupby(lines)]


class KlipperWire(FamilyWire):
    printer_class = FakeKlipper
    protocol_class = KlipperProtocol
    noisy = False
    once = True


TestDuet = as_test(FamilyWire, 50)
TestKlipper = as_test(KlipperWire, 50)
