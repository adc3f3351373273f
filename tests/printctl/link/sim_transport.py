"""A wire between the link and the simulated printer inside one process, in virtual time.

Clock and printer move together: what the host waits, the printer lives through. Bits flip in both
directions, oks are lost and replies come late as the generator says.
"""

from __future__ import annotations

import re

import numpy as np

from printctl.link.clock import VirtualClock
from sim.marlin import MarlinPrinter
from tests.printctl.link.fake_marlin import slips_through

_OK = re.compile(rb"(?m)^ok\n")


class SimTransport:
    """See `printctl.link.transport.Transport`.

    Parameters
    ----------
    printer : MarlinPrinter
    clock : VirtualClock
    rng : Generator, optional
    noise : float
        Chance that one bit of a byte flips, both ways.
    drop_ok : float
        Chance that a bare ``ok`` is lost.
    delay : float
        Chance that a reply comes late.
    delay_s : float
        By how much.
    honest : bool
        Whether the checksum finds every garbled line: an XOR lets an even number of flips of one
        bit through; such noise is then drawn again. ``slips`` counts it.
    """

    quiet_s = 0.05

    def __init__(
        self,
        printer: MarlinPrinter,
        clock: VirtualClock,
        rng: np.random.Generator | None = None,
        noise: float = 0.0,
        drop_ok: float = 0.0,
        delay: float = 0.0,
        delay_s: float = 0.3,
        honest: bool = True,
    ) -> None:
        self.name = "simulated"
        self.printer, self.clock = printer, clock
        self._rng = rng or np.random.default_rng(0)
        self._noise, self._drop_ok = noise, drop_ok
        self._delay, self._delay_s = delay, delay_s
        self._late: list[tuple[float, bytes]] = []
        self.slips, self._honest = 0, honest

    def write(self, data: bytes) -> None:
        self.printer.run_to(self.clock.now())
        garbled = self._garble(data)
        while slips_through(data, garbled):
            self.slips += 1
            if not self._honest:
                break
            garbled = self._garble(data)
        self.printer.receive(garbled)

    write_urgent = write

    def read(self, timeout: float) -> bytes:
        until = self.clock.now() + timeout
        self.printer.settle()
        said = self.printer.take_output()
        if said:
            self.clock.move_to(self.printer.now)
            self._say(said)
        if self._late and self._late[0][0] <= max(until, self.clock.now()):
            due, data = self._late.pop(0)
            self.clock.move_to(due)
            return data
        self.clock.move_to(until)
        self.printer.run_to(self.clock.now())
        return b""

    def _say(self, said: bytes) -> None:
        if self._drop_ok:
            said = _OK.sub(lambda m: b"" if self._rng.random() < self._drop_ok else m[0], said)
        if said:
            late = self._delay_s if self._rng.random() < self._delay else 0.0
            after = self._late[-1][0] if self._late else 0.0
            self._late.append((max(after, self.clock.now() + late), self._garble(said)))

    def _garble(self, data: bytes) -> bytes:
        if not self._noise:
            return data
        hit = self._rng.random(len(data)) < self._noise
        if not hit.any():
            return data
        bits = (1 << self._rng.integers(0, 8, len(data))).astype(np.uint8)
        return bytes(np.frombuffer(data, np.uint8) ^ np.where(hit, bits, 0).astype(np.uint8))

    def reset(self) -> bool:
        self.printer.reset()
        return True

    def close(self) -> None:
        pass
