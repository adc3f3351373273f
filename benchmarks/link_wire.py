"""A bad wire between the link and the simulated printer, in virtual time, that knows the truth.

Clock and printer move together: what the host waits, the printer lives through. Bits flip both
ways, oks are lost, replies come late, the connection breaks (all that was under way is lost), as
the generator says. Every line that the printer takes is written down beside what the host meant.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from benchmarks.checkers.link_order import Taken, body_of
from printctl.link.clock import VirtualClock
from printctl.link.errors import PortLost
from sim.marlin import MarlinPrinter

_OK: Final = re.compile(rb"(?m)^ok\n")


@dataclass(frozen=True)
class Troubles:
    """What goes wrong, each as a chance: per byte, per ok, per reply, per line written."""

    noise: float = 0.0
    drop_ok: float = 0.0
    delay: float = 0.0
    delay_s: float = 0.3
    breaks: float = 0.0


@dataclass
class Ledger:
    """What the printer took, and when it stopped or started anew.

    Attributes
    ----------
    taken : list of Taken
    kills, resets : list of float, s
    """

    printer: MarlinPrinter
    taken: list[Taken] = field(default_factory=list)
    kills: list[float] = field(default_factory=list)
    resets: list[float] = field(default_factory=list)
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


class Wire:
    """See `printctl.link.transport.Transport`."""

    quiet_s = 0.05

    def __init__(
        self,
        ledger: Ledger,
        clock: VirtualClock,
        rng: np.random.Generator,
        troubles: Troubles = Troubles(),
    ) -> None:
        self.name = "simulated"
        self.ledger, self.printer, self.clock = ledger, ledger.printer, clock
        self._rng, self._troubles = rng, troubles
        self._late: list[tuple[float, bytes]] = []
        self._broken = False

    def write(self, data: bytes) -> None:
        """Give the printer what noise leaves of ``data``."""
        self._check()
        self.printer.run_to(self.clock.now())
        self.ledger.sent(data)
        if self._rng.random() < self._troubles.breaks:
            self._broken = True
            data = data[: self._rng.integers(0, len(data) + 1)]
        self.printer.receive(self._garble(data))

    write_urgent = write

    def read(self, timeout: float) -> bytes:
        """Let the printer work, and give what noise leaves of its words."""
        until = self.clock.now() + timeout
        self.printer.settle()
        said = self.printer.take_output()
        if said:
            self.clock.move_to(self.printer.now)
            self._say(said)
        self._check()
        if self._late and self._late[0][0] <= max(until, self.clock.now()):
            due, data = self._late.pop(0)
            self.clock.move_to(due)
            return data
        self.clock.move_to(until)
        self.printer.run_to(self.clock.now())
        return b""

    def _check(self) -> None:
        if self._broken or self.printer.unplugged:
            raise PortLost("the simulated connection broke")

    def _say(self, said: bytes) -> None:
        troubles, rng = self._troubles, self._rng
        if troubles.drop_ok:
            said = _OK.sub(lambda m: b"" if rng.random() < troubles.drop_ok else m[0], said)
        if said:
            late = troubles.delay_s if rng.random() < troubles.delay else 0.0
            after = self._late[-1][0] if self._late else 0.0
            self._late.append((max(after, self.clock.now() + late), self._garble(said)))

    def _garble(self, data: bytes) -> bytes:
        if not self._troubles.noise:
            return data
        hit = self._rng.random(len(data)) < self._troubles.noise
        if not hit.any():
            return data
        bits = (1 << self._rng.integers(0, 8, len(data))).astype(np.uint8)
        return bytes(np.frombuffer(data, np.uint8) ^ np.where(hit, bits, 0).astype(np.uint8))

    def reset(self) -> bool:
        """Pull the board's reset line."""
        self.printer.reset()
        return True

    def close(self) -> None:
        """Nothing to let go of."""
