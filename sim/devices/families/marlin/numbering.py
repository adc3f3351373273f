"""Marlin's line numbers, checksums and resend requests; emergency codes that bypass the queue."""

from __future__ import annotations

import re
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Steps, Task, WaitStandstill
from sim.devices.board.wire import RefusedLine
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


# Marlin's emergency codes, which bypass the queue: M108, M112 and M410.
#
# With EMERGENCY_PARSER they act as their bytes arrive, wherever they stand in the line of commands;
# without, as their line enters the queue.

EMERGENCY: Final = re.compile(rb" *(?:N[0-9 -]*)?M *(108|112|410)")
"""Begin of a line that the emergency parser acts on."""
QUICKSTOP_S: Final = 1.024
"""For so long after a quickstop the planner takes no moves: 1000 ticks at 976.6 Hz."""
_NAMES: Final = (b"M112", b"M410", b"M108")


def code_on_entering(line: bytes) -> bytes | None:
    """The code of a line that acts as it enters the queue, where there is no emergency parser."""
    return line[1:4] if line[:4] in _NAMES else None


def act_urgently(board: Controller, code: bytes) -> Steps:
    """Kill (M112), end a wait (M108), or drop all moves (M410)."""
    machine = board.machine
    if code == b"112":
        board.kill("M112 Shutdown")
    elif code == b"108":
        machine.waits_for_user = False
        machine.heat.awaited = False
    else:
        return quickstop(board)
    return None


def quickstop(board: Controller) -> Task:
    """Drop all moves at once; for a second the planner takes no others."""
    machine = board.machine
    machine.stop()
    machine.motion.closed_until = machine.now + QUICKSTOP_S
    yield WaitStandstill()
