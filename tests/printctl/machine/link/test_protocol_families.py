"""Link protocols of other families, property-based; only noise that their checks detect."""

from __future__ import annotations

from functools import partial
from itertools import groupby

from firmware_profiles.families.klipper.protocol import KlipperProtocol
from firmware_profiles.families.reprapfirmware.facts import RrfProtocol
from printctl.machine.link.modal import places
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.wire_machine import FILE, WireMachine, as_test


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
