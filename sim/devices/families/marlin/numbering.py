"""Marlin's line numbers, checksums and resend requests."""

from __future__ import annotations

import re
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.lines import RefusedLine
from sim.gcode.program.gcode import checksum

_INTEGER: Final = re.compile(rb"\s*([+-]?\d+)")

LINE_NUMBER: Final = b"Line Number is not Last Line Number+1"
CHECKSUM: Final = b"checksum mismatch"
NO_CHECKSUM: Final = b"No Checksum with line number"


def to_integer(text: bytes) -> int:
    """Leading integer as C's strtol reads it; 0 where there is none."""
    match = _INTEGER.match(text)
    return int(match[1]) if match else 0


class MarlinNumbering:
    """Takes the next number with a good checksum.

    Attributes
    ----------
    last_number : int
        Of the last accepted line.
    """

    def __init__(self) -> None:
        self.last_number = 0

    def accept(self, line: bytes) -> bytes | RefusedLine | None:
        """The command to queue; `RefusedLine`; or None for a repeated line, which is dropped.

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
            return RefusedLine(LINE_NUMBER)
        star = line.rfind(b"*")
        if star < 0:
            return RefusedLine(NO_CHECKSUM)
        if to_integer(line[star + 1 :]) != checksum(line[:star]):
            return RefusedLine(CHECKSUM)
        self.last_number = number
        return line

    def clear(self) -> None:
        """Forget the numbers, as a reset does."""
        self.last_number = 0


def request_resend(board: Controller) -> None:
    """Ask for the line after the last good one; what is in the ring is thrown away."""
    board.wire.deliver(board.machine.now)
    board.wire.flush()
    board.machine.say(f"Resend: {board.lines.last_number + 1}")
    board.machine.say("ok")
