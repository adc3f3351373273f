"""RepRapFirmware's two checksum types; line numbers aren't compared."""

from __future__ import annotations

import re
from typing import Final

from sim.gcode.program.gcode import checksum

_NUMBER: Final = re.compile(rb"N(\d+)")
_DIGITS: Final = re.compile(rb"\d*")


def crc16(data: bytes) -> int:
    """CRC-16, polynomial 0x1021, start 0, most significant bit first."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


class DuetNumbering:
    """RepRapFirmware's line numbering: accepts what isn't provably wrong.

    Attributes
    ----------
    last_number : int
        Of the last line with a checksum.
    """

    def __init__(self) -> None:
        self.last_number = 0

    def accept(self, line: bytes) -> bytes | None:
        """The command to queue, or None for a line that is dropped."""
        number = _NUMBER.match(line)
        body, star, given = line.partition(b"*")
        if number is None or not star:
            return line
        match = _DIGITS.match(given)
        digits = match[0] if match else b""
        wanted = {1: checksum, 2: checksum, 3: checksum, 5: crc16}.get(len(digits))
        if wanted is None or wanted(body) != int(digits):
            return None
        self.last_number = int(number[1])
        return body

    def clear(self) -> None:
        """Forget the numbers, as a reset does."""
        self.last_number = 0
