"""Marlin by properties: whatever the wire does, no line is lost, doubled or swapped."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import rule

from printctl.link.marlin_doubt import Timing
from printctl.link.pairing import Pairing
from printctl.link.protocol_marlin import MarlinProtocol
from tests.printctl.link.fake_marlin import FakeMarlin, slips_through
from tests.printctl.link.wire_machine import MANUAL, WireMachine, as_test


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
