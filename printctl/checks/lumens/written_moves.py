"""Extract the writing moves of a G-code file (plunger or valve), as commanded or as executed."""

from __future__ import annotations

from typing import Final

import numpy as np

from firmware_profiles import Printer
from gcode.deposit.written import Strands
from gcode.dry_run.run import DryRun
from gcode.heads import as_plunger, flowing
from gcode.program.gcode import Program, code, parse_line
from gcode.program.modal import MOVE
from gcode.program.valve import Valve
from kernels.arrays import FloatArray, IntArray

LEAST_MM: Final = 1e-6
"""A shorter way is none."""


def plunger_strokes(program: Program, ul_per_e: float, *, level: bool = True) -> Strands:
    """Moves that push ink on their way; sideways where they must be ``level``."""
    begin = program.before[:, :3]
    pushed = np.diff(program.plunger, prepend=0.0)
    length = np.linalg.norm((program.target[:, :3] - begin)[:, : 2 if level else 3], axis=1)
    moves = program.kind == MOVE
    wrote = moves & (pushed > 0) & (length > LEAST_MM)
    chosen = np.flatnonzero(wrote)
    return Strands.dosed(
        begin[chosen],
        program.target[chosen, :3],
        pushed[chosen] * ul_per_e,
        np.cumsum(~wrote & moves)[chosen],
        program.line[chosen],
    )


def valve_strokes(
    program: Program, valve: Valve, flow_ul_s: float, *, level: bool = True
) -> Strands:
    """Moves with the valve open, as fed: each gets the flow for as long as its feed asks."""
    begin = program.before[:, :3]
    way = program.target[:, :3] - begin
    length = np.linalg.norm(way[:, : 2 if level else 3], axis=1)
    wrote = (program.kind == MOVE) & valve.is_open & (length > LEAST_MM)
    chosen = np.flatnonzero(wrote)
    took = np.linalg.norm(way[chosen], axis=1) / np.maximum(program.feed[chosen], LEAST_MM)
    return Strands.dosed(
        begin[chosen],
        program.target[chosen, :3],
        took * flow_ul_s,
        np.cumsum(~wrote)[chosen],
        program.line[chosen],
    )


def run_strokes(
    run: DryRun,
    printer: Printer,
    ul_per_mm: float,
    flow_ul_s: float | None,
    *,
    level: bool = True,
) -> Strands:
    """What the dry run's motors do: between whole steps, in the planner's own time.

    Parameters
    ----------
    run : DryRun
    printer : Printer
    ul_per_mm : float, µL/mm
        Of the plunger; of no account where a valve writes.
    flow_ul_s : float or None, µL/s
        Of a pneumatic head while its valve is open: a block that slows down for a corner gets
        more.
    level : bool
        Whether only ways sideways count.
    """
    motion, row = run.executed, _rows(run)
    if run.valve is not None and printer.pneumatic is not None and flow_ul_s is not None:
        spans = flowing(motion, run.program, run.valve, printer.pneumatic)
        motion = as_plunger(motion, spans, flow_ul_s)
        dose = motion.plunger_end - motion.plunger_start
        writes = dose > 0
        # A line that waits for the wire with the valve open stays one line.
        unbroken = writes
    else:
        dose = (motion.plunger_end - motion.plunger_start) * ul_per_mm
        # A move too short for a step of the plunger writes all the same.
        writes = np.append(run.doses, False)[row[motion.line]]
        unbroken = np.zeros(len(writes), dtype=bool)
    length = np.linalg.norm((motion.end - motion.start)[:, : 2 if level else 3], axis=1)
    wrote = writes & (length > LEAST_MM)
    chosen = np.flatnonzero(wrote)
    lines = np.append(run.program.line, 0)
    return Strands.dosed(
        motion.start[chosen],
        motion.end[chosen],
        np.maximum(dose[chosen], 0.0),
        np.cumsum(~(wrote | unbroken))[chosen],
        lines[row[motion.line[chosen]]],
    )


def _rows(run: DryRun) -> IntArray:
    """Row of the program of each command, and behind them (and for -1) one past the last row."""
    program = run.program
    count = int(program.command.max()) + 1 if len(program) else 0
    row = np.full(count + 1, len(program), dtype=np.int64)
    # Of an arc's rows the first: what a command does is the same in all of them.
    row[program.command[::-1]] = np.arange(len(program))[::-1]
    return row


def origin(program: Program, gcode: bytes) -> FloatArray:
    """What to add to the reader's positions for those that the file writes, (3,), mm.

    A job may begin by saying with G92 where the tip stands; the reader, which knows no place for
    it, begins at zero.
    """
    moves = np.flatnonzero(program.kind == MOVE)
    before = np.flatnonzero(program.code[: moves[0] if len(moves) else 0] == code("G92"))
    added = np.zeros(3)
    for row in before:
        text = gcode.split(b"\n", int(program.line[row]))[int(program.line[row]) - 1]
        values = parse_line(text).values
        for axis, letter in enumerate("XYZ"):
            if letter in values:
                added[axis] = values[letter] - program.target[row, axis]
    return added
