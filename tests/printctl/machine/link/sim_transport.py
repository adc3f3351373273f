"""Noisy simulated serial line; all errors are detectable by the checksum."""

from __future__ import annotations

import numpy as np

from printctl.machine.ports.clock import VirtualClock
from sim.devices.families.marlin_printer import MarlinPrinter
from sim.devices.faults import PermanentFaults
from tests.printctl.machine.link.fake_marlin import slips_through
from tests.printctl.machine.link.simulated_transport import SimulatedTransport


class SimTransport(SimulatedTransport):
    """Noise that would slip through the XOR of a line is drawn again."""

    def __init__(
        self,
        printer: MarlinPrinter,
        clock: VirtualClock,
        rng: np.random.Generator | None = None,
        **troubles: float,
    ) -> None:
        super().__init__(printer, clock, PermanentFaults(**troubles), rng)

    def on_the_way(self, data: bytes) -> bytes:
        garbled = super().on_the_way(data)
        while slips_through(data, garbled):
            garbled = super().on_the_way(data)
        return garbled
