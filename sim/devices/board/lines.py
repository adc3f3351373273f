"""Split a simulated board's received bytes into lines; interface for checking their numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Protocol

_EOL: Final = re.compile(rb"[\r\n]")


@dataclass(frozen=True)
class RefusedLine:
    """A line that isn't taken: why, in the firmware's words."""

    reason: bytes


class Numbering(Protocol):
    """A firmware's rule about line numbers and checksums.

    Attributes
    ----------
    last_number : int
        Of the last accepted line.
    """

    last_number: int

    def accept(self, line: bytes) -> bytes | RefusedLine | None:
        """Return the command to queue, `RefusedLine`, or None for a line that is dropped."""

    def clear(self) -> None:
        """Forget the numbers, as a reset does."""


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
