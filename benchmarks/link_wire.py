"""Faulty simulated serial line in virtual time, which records what was really sent.

Every line that the printer takes is written down beside what the host meant.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.checkers.link_order import Taken, body_of
from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import PortLost
from sim.devices.families.marlin.printer import MarlinPrinter
from sim.devices.faults import PermanentFaults
from tests.printctl.machine.link.simulated_transport import SimulatedTransport


@dataclass
class Ledger:
    """What the printer took, and when it stopped or started anew.

    Attributes
    ----------
    taken : list of Taken
    kills, resets : list of float, s
    forged : int
        How often noise made an M112 of another command on its way.
    """

    printer: MarlinPrinter
    taken: list[Taken] = field(default_factory=list)
    kills: list[float] = field(default_factory=list)
    resets: list[float] = field(default_factory=list)
    forged: int = 0
    meant: dict[int, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        printer: Any = self.printer
        self._accept, self._kill, self._reset = printer.lines.accept, printer.kill, printer.reset
        printer.lines.accept, printer.kill, printer.reset = self._on_line, self._on_kill, self._boot

    def sent(self, data: bytes) -> None:
        """The host writes lines."""
        for line in data.split(b"\n"):
            number, text = body_of(line)
            if number is not None:
                self.meant[number] = text.strip()

    def _on_line(self, line: bytes) -> Any:
        verdict = self._accept(line)
        if isinstance(verdict, bytes):
            number, _ = body_of(line)
            meant = None if number is None else self.meant.get(number)
            self.taken.append(Taken(self.printer.now, line, meant))
        return verdict

    def _on_kill(self, reason: str) -> None:
        self.kills.append(self.printer.now)
        self._kill(reason)

    def _boot(self) -> None:
        self.resets.append(self.printer.now)
        self._reset()


class BreakingTroubles(PermanentFaults):
    """With a chance, per line written, that the connection is lost with all that is under way."""

    breaks: float = 0.0


class Wire(SimulatedTransport):
    """Writes down what the host meant; breaks as its troubles say."""

    def __init__(
        self,
        ledger: Ledger,
        clock: VirtualClock,
        rng: np.random.Generator,
        troubles: BreakingTroubles = BreakingTroubles(),  # noqa: B008
    ) -> None:
        super().__init__(ledger.printer, clock, troubles, rng)
        self.ledger = ledger
        self._rng, self._breaks = rng, troubles.breaks
        self._broken = False

    def on_the_way(self, data: bytes) -> bytes:
        """Note what the host sends, and lose its end where the connection breaks."""
        self.ledger.sent(data)
        if self._rng.random() < self._breaks:
            self._broken = True
            data = data[: self._rng.integers(0, len(data) + 1)]
        arrives = super().on_the_way(data)
        self.ledger.forged += b"M112" in arrives and b"M112" not in data
        return arrives

    def _check(self) -> None:
        super()._check()
        if self._broken:
            raise PortLost("the simulated connection broke")
