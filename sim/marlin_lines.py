"""From bytes to accepted commands: Marlin's line assembly, line numbers and checksums."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from sim.gcode import checksum

_EOL: Final = re.compile(rb"[\r\n]")
_INTEGER: Final = re.compile(rb"\s*([+-]?\d+)")

LINE_NUMBER: Final = b"Line Number is not Last Line Number+1"
CHECKSUM: Final = b"checksum mismatch"
NO_CHECKSUM: Final = b"No Checksum with line number"


def to_integer(text: bytes) -> int:
    """Leading integer as C's strtol reads it; 0 where there is none."""
    match = _INTEGER.match(text)
    return int(match[1]) if match else 0


@dataclass(frozen=True)
class Refused:
    """A line with a wrong number or checksum: why."""

    reason: bytes


class LineReader:
    """Cuts the ring into lines and decides about their numbers.

    Attributes
    ----------
    last_number : int
        Of the last accepted line.
    """

    def __init__(self, max_line_bytes: int) -> None:
        self.last_number = 0
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

    def accept(self, line: bytes) -> bytes | Refused | None:
        """The command to queue; `Refused`; or None for a repeated line, which is dropped.

        A line without a number is taken as it is, whatever its checksum.
        """
        if not line.startswith(b"N"):
            return line
        renumbers = b"M110" in line
        at = max(line.find(b"N", 4), 0) if renumbers else 0
        number = to_integer(line[at + 1 :])
        if number != self.last_number + 1 and not renumbers:
            if self.last_number - 1 <= number <= self.last_number:
                return None
            return Refused(LINE_NUMBER)
        star = line.rfind(b"*")
        if star < 0:
            return Refused(NO_CHECKSUM)
        if to_integer(line[star + 1 :]) != checksum(line[:star]):
            return Refused(CHECKSUM)
        self.last_number = number
        return line

    def clear(self) -> None:
        """Forget the half line and the numbers, as a reset does."""
        self.last_number = 0
        self._partial.clear()
