"""Hypothesis state machine of wire and firmware faults, with the invariants of each family."""

from __future__ import annotations

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from firmware_profiles.families.link_protocol import (
    FirmwareReset,
    LinesResent,
    LostSynchronisation,
    NoReply,
    StrayOk,
    Synchronised,
)
from tests.printctl.machine.link.fake_marlin import zigzag
from tests.slower import examples

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
