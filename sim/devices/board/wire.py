"""Serial line of a simulated board: bytes in flight, receive ring, emergency codes."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

BITS_PER_BYTE: Final = 10
_EOL: Final = re.compile(rb"[\r\n]")
_CHUNK: Final = 48
"""Bytes after which a waiting main loop surely has looked into the ring."""


class Wire:
    """Bytes on their way, one after the other at the baud rate, into a ring that can overrun.

    Parameters
    ----------
    urgent : pattern, optional
        Begin of a line that the firmware acts on as its bytes arrive; its group is the code.

    Attributes
    ----------
    byte_s : float
        Time of one byte.
    capacity : int
        Bytes that the ring holds (one less than its size).
    lost : int
        Bytes that found it full.
    received : int
        Bytes that arrived, but for those of moves that took the short road.
    urgent : list of bytes
        Codes (``b"112"``) that were seen on arrival and not acted on yet.
    """

    def __init__(self, baud: int, ring_bytes: int, urgent: re.Pattern[bytes] | None = None) -> None:
        self.byte_s = BITS_PER_BYTE / baud
        self.capacity = ring_bytes - 1
        self.lost = self.received = 0
        self.urgent: list[bytes] = []
        self.ring = bytearray()
        self._pattern = urgent
        self._line = bytearray()
        self._flying = bytearray()
        self._first_at = 0.0
        self._free_at = 0.0

    @property
    def quiet(self) -> bool:
        """Whether nothing is in flight, in the ring or half looked at on arrival."""
        return not (self._flying or self.ring or self._line)

    def send(self, now: float, data: bytes) -> None:
        """Put bytes on the line at ``now``, s; they queue behind those already on it."""
        if not data:
            return
        begin = max(now, self._free_at)
        if not self._flying:
            self._first_at = begin + self.byte_s
        self._flying += data
        self._free_at = self._first_at + (len(self._flying) - 1) * self.byte_s

    def occupied_until(self, now: float) -> float:
        """When the line is free for the next byte, s."""
        return max(now, self._free_at)

    def next_arrival(self) -> float | None:
        """When the main loop should next look: the end of a line, or some bytes on, s."""
        if not self._flying:
            return None
        match = _EOL.search(self._flying)
        count = match.end() if match else len(self._flying)
        return self._first_at + (min(count, _CHUNK) - 1) * self.byte_s

    def deliver(self, now: float) -> None:
        """Move what has arrived by ``now``, s, into the ring; surplus is lost."""
        if not self._flying or now < self._first_at - 1e-12:
            return
        count = int((now - self._first_at) / self.byte_s + 1e-6) + 1
        arrived = self._flying[:count]
        del self._flying[:count]
        self._first_at += len(arrived) * self.byte_s
        self.received += len(arrived)
        if self._pattern is not None:
            self._watch(arrived, self._pattern)
        room = self.capacity - len(self.ring)
        self.lost += max(len(arrived) - room, 0)
        self.ring += arrived[:room]

    def _watch(self, arrived: bytes | bytearray, pattern: re.Pattern[bytes]) -> None:
        self._line += arrived
        while (match := _EOL.search(self._line)) is not None:
            seen = pattern.match(self._line)
            if seen and seen.end() <= match.start():
                self.urgent.append(seen[1])
            del self._line[: match.end()]

    def flush(self) -> None:
        """Empty the ring, as a request to resend does, in mid-line or not."""
        self.ring.clear()

    def clear(self) -> None:
        """Forget everything, as a reset does."""
        self.ring.clear()
        self._flying.clear()
        self._line.clear()
        self.urgent.clear()


@dataclass(frozen=True)
class RefusedLine:
    """A line that isn't taken: why, in the firmware's words."""

    reason: bytes


class Numbering(ABC):
    """A firmware's rule about line numbers and checksums.

    Attributes
    ----------
    last_number : int
        Of the last accepted line.
    """

    def __init__(self) -> None:
        self.last_number = 0

    @abstractmethod
    def accept(self, line: bytes) -> bytes | RefusedLine | None:
        """Return the command to queue, `RefusedLine`, or None for a line that is dropped."""

    def clear(self) -> None:
        """Forget the numbers, as a reset does."""
        self.last_number = 0


class LineReader:
    """Cuts the receive ring into lines.

    Parameters
    ----------
    max_line_bytes : int
        Room for a line, with its end.
    """

    def __init__(self, max_line_bytes: int) -> None:
        self._keep = max_line_bytes - 1
        self._partial = bytearray()

    @property
    def empty(self) -> bool:
        """Whether no half line waits."""
        return not self._partial

    def next_line(self, ring: bytearray) -> bytes | None:
        """Next non-empty line without comment, cut to the firmware's length; None if there is none.

        What it reads it takes out of ``ring``.
        """
        while ring:
            match = _EOL.search(ring)
            if match is None:
                self._partial += ring
                ring.clear()
                return None
            self._partial += ring[: match.start()]
            del ring[: match.end()]
            text = bytes(self._partial.partition(b";")[0][: self._keep])
            self._partial.clear()
            if text:
                return text.lstrip(b" ")
        return None

    def clear(self) -> None:
        """Forget the half line, as a reset does."""
        self._partial.clear()
