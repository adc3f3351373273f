"""Change heads on a simulated board without motion or reply: new plunger, shifted offsets."""

from __future__ import annotations

from sim.devices.board.controller import Controller
from sim.devices.board.waits import Task, WaitStandstill
from sim.gcode.program.modal import interpret


def take_tool_in_silence(board: Controller, number: int) -> Task:
    """Use another head once the motors stand.

    The place keeps its name for the carriage; what the user calls it shifts by the offsets.
    """
    motion = board.machine.motion
    yield WaitStandstill()
    shift = motion.tool_offset[number] - motion.tool_offset[motion.tool]
    interpret(motion.modal[0], board.words[0])
    board.machine.use_head(number)
    motion.modal["shift"][0] += shift
