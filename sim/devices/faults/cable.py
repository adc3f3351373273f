"""Simulated cable between host and printer: flipped bits, lost and late replies.

Modelled: one bit of a byte flips, each byte by itself at the same chance, or of a burst's bytes
at the burst's; a byte is lost; a bare ``ok`` is lost whole; a reply, or each ``ok`` by its own
delay, comes late, and what is behind it no sooner: so oks come bunched.
Not modelled: bytes that are invented, framing errors, noise that comes in bursts of its
own accord, what a USB adapter's packets do to the gaps between bytes.

Whoever owns the cable has the clock: the process that serves the printer real seconds, a
transport in virtual time that clock's.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from sim.devices.faults.fault_file import Direction, PermanentFaults

_OK: Final = re.compile(rb"(?m)^ok\n")
_BEGINS_OK: Final = re.compile(rb"(?m)^ok")


class FaultyCable:
    """Simulated cable with errors.

    Parameters
    ----------
    troubles : PermanentFaults
    rng : Generator, optional
        Of what goes wrong; needed where anything does by chance.
    """

    def __init__(
        self, troubles: PermanentFaults | None = None, rng: np.random.Generator | None = None
    ) -> None:
        self.troubles = troubles or PermanentFaults()
        self._rng = rng or np.random.default_rng(0)
        self._late: deque[tuple[float, bytes]] = deque()
        self._burst_rate, self._burst_left = 0.0, 0
        self._hold_s = 0.0
        self._oks = 0
        self._ok_late_s = self.troubles.ok_delay_up_to_s

    def burst(self, rate: float, length_bytes: int) -> None:
        """Garble ``rate`` of the next ``length_bytes``, both ways."""
        self._burst_rate, self._burst_left = rate, length_bytes

    def hold(self, seconds: float) -> None:
        """Let the next reply come ``seconds`` late."""
        self._hold_s = seconds

    def delay_oks(self, up_to_s: float) -> None:
        """Let each ok to come be late by chance, up to so many seconds."""
        self._ok_late_s = up_to_s

    def down(self, data: bytes) -> bytes:
        """What of the host's bytes reaches the printer."""
        return self._garble(data, "down")

    def up(self, data: bytes, now: float) -> None:
        """The printer says something at ``now``, s; `due` gives it to the host."""
        troubles, rng = self.troubles, self._rng
        if troubles.drop_ok:
            data = _OK.sub(lambda m: b"" if rng.random() < troubles.drop_ok else m[0], data)
        if not data:
            return
        late, self._hold_s = troubles.latency_s + self._hold_s, 0.0
        if troubles.delay and rng.random() < troubles.delay:
            late += troubles.delay_s
        for part, ok_late in self._by_ok(data):
            after = self._late[-1][0] if self._late else 0.0
            self._late.append((max(after, now + late + ok_late), self._garble(part, "up")))

    def _by_ok(self, data: bytes) -> Iterator[tuple[bytes, float]]:
        """Cut before each ok that is late, and say how much."""
        if not self.troubles.ok_delays_s and not self._ok_late_s:
            yield data, 0.0
            return
        begin, late = 0, 0.0
        for match in _BEGINS_OK.finditer(data):
            if match.start() > begin:
                yield data[begin : match.start()], late
            begin, late = match.start(), self._ok_delay()
        yield data[begin:], late

    def _ok_delay(self) -> float:
        """Of the next ok, s."""
        cycle = self.troubles.ok_delays_s
        self._oks += 1
        late = cycle[(self._oks - 1) % len(cycle)] if cycle else 0.0
        if self._ok_late_s:
            late += float(self._rng.random()) * self._ok_late_s
        return late

    @property
    def next_s(self) -> float:
        """When the next reply reaches the host, s; infinite for none."""
        return self._late[0][0] if self._late else math.inf

    def due(self, now: float) -> bytes:
        """The next reply, if it has reached the host by ``now``, s."""
        return self._late.popleft()[1] if self._late and self._late[0][0] <= now else b""

    def clear(self) -> None:
        """Lose what is under way: the cable was pulled."""
        self._late.clear()

    def _garble(self, data: bytes, direction: Direction) -> bytes:
        on = self.troubles.noise_on in ("both", direction)
        if on and self.troubles.drop_byte:
            kept = self._rng.random(len(data)) >= self.troubles.drop_byte
            data = np.frombuffer(data, np.uint8)[kept].tobytes()
        rate = self.troubles.noise if on else 0.0
        if not rate and not self._burst_left:
            return data
        rates = np.full(len(data), rate)
        rates[: self._burst_left] = np.maximum(rates[: self._burst_left], self._burst_rate)
        self._burst_left = max(self._burst_left - len(data), 0)
        hit = self._rng.random(len(data)) < rates
        if not hit.any():
            return data
        bits = (1 << self._rng.integers(0, 8, len(data))).astype(np.uint8)
        return bytes(np.frombuffer(data, np.uint8) ^ np.where(hit, bits, 0).astype(np.uint8))
