"""Marlin's emergency codes, which bypass the queue: M108, M112 and M410.

With EMERGENCY_PARSER they act as their bytes arrive, wherever they stand in the line of commands;
without, as their line enters the queue.
"""

from __future__ import annotations

import re
from typing import Final

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Steps, Task, WaitStandstill

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
