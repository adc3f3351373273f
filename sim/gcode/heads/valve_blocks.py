"""Assign each executed motion block to its G-code command, to time the valve.

A printer counts the lines that it is sent, and a host puts in lines of its own (a checkpoint's
question, a pause), so the count alone doesn't tell the file's command. The places do: blocks end,
in the file's order, where its moves end, to a motor step, and begin where the last one of the file
ended; a move that the planner merged into the next has none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from sim.gcode.motion.executed import ExecutedMotion
from sim.gcode.program.gcode import Program
from sim.gcode.program.modal import MOVE

WITHIN_MM: Final = 0.02
"""A step of a usual axis and the rounding of the text; a place is told from the next by more."""
AHEAD: Final = 64
"""Moves that may be merged or left out in a row."""


def with_commands(executed: ExecutedMotion, program: Program) -> ExecutedMotion:
    """The motion with each block's `line` the file's command from 0; -1 for a host's own.

    Parameters
    ----------
    executed : ExecutedMotion
    program : Program
        Read with the tip where the motion begins.
    """
    rows = np.flatnonzero(program.kind == MOVE)
    target = program.target[rows, :3]
    line = np.full(len(executed), -1, dtype=np.int64)
    at, last = 0, program.start[:3]
    for block, end in enumerate(executed.end):
        if np.abs(executed.start[block] - last).max() > WITHIN_MM:
            continue
        near = np.abs(target[at : at + AHEAD] - end).max(axis=1) <= WITHIN_MM
        if near.any():
            nearest = at + int(near.argmax())
            line[block] = program.command[rows[nearest]]
            at, last = nearest + 1, target[nearest]
    return replace(executed, line=line)
