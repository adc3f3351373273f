"""Marlin's link protocol, property-based: no line lost, doubled or swapped by noise."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import invariant, rule

from firmware_profiles.families.link_protocol import Timing
from firmware_profiles.families.marlin.protocol import MarlinProtocol
from firmware_profiles.families.pairing import Pairing
from tests.printctl.machine.link.fake_marlin import FakeMarlin, slips_through
from tests.printctl.machine.link.queueing_marlin import QueueingMarlin
from tests.printctl.machine.link.wire_machine import MANUAL, WireMachine, as_test


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
