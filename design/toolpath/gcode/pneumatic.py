"""Adapt G-code to pneumatic heads: feed rates that suit their flow, valve commands.

The pressure fixes the flow Q, so a move of length l that is to lay the volume V must take V/Q:
its speed is Q l/V, whatever the toolpath asked for. The valve opens and closes while the head
stands (M400, or the dialect's own wait, before each), and the head waits for the valve's delay
after each: ink flows before the first move begins, and no more when the needle leaves. What flows
while the valve closes is laid on the spot. Primes and retractions are left out: there is no
plunger to relieve, a closed valve takes the pressure off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import ToolpathError
from design.toolpath.gcode.commands import DWELL, MachineMoves, per_axis
from design.toolpath.gcode.job import HeadLoad
from design.toolpath.gcode.marks import Marks, in_order
from design.toolpath.gcode.table import Table, decimals_for
from design.toolpath.toolpath import MoveKind, Toolpath
from firmware_profiles import Pneumatic, Printer
from firmware_profiles.families.dialect import Dialect
from kernels.arrays import FloatArray, IntArray

ROUNDING: Final = 1e-9
"""Part of a speed by which it may be beyond its limit."""


def at_flow(
    moves: MachineMoves,
    toolpath: Toolpath,
    printer: Printer,
    place_mm: FloatArray,
    load: HeadLoad,
    *,
    standing_doses: bool,
) -> MachineMoves:
    """Give each writing command the speed at which the flow lays its volume.

    Parameters
    ----------
    moves : MachineMoves
        Of the toolpath alone.
    toolpath : Toolpath
    printer : Printer
        With this head alone.
    place_mm : (3,) float64, mm
        From the part's frame to the printer's.
    load : HeadLoad
        Its flow, and the ink's speeds.
    standing_doses : bool
        As in `GcodeOptions`.

    Raises
    ------
    ToolpathError
        Where a speed is beyond what an axis or the ink bears; names layer or vessel, and place.
    """
    flow = _flow(printer, load)
    kind = toolpath.kind[moves.move]
    writes = kind == MoveKind.WRITE
    laid = np.where(toolpath.kind == MoveKind.WRITE, toolpath.volume_ul, 0.0).cumsum()
    volume = np.diff(laid[moves.move], prepend=0.0)
    way = _written_way(moves, printer, toolpath.start[0] + place_mm)
    length = np.linalg.norm(way, axis=1)
    _refuse_dry(toolpath, moves, writes & (length > 0) & (volume <= 0))
    speed = moves.speed_mm_s.copy()
    np.divide(flow * length, volume, out=speed, where=writes & (volume > 0))
    _refuse_beyond(toolpath, printer, replace(moves, speed_mm_s=speed), way, load)
    if not standing_doses:
        return replace(moves, speed_mm_s=speed)
    doses = kind == MoveKind.PRIME
    return replace(
        moves,
        speed_mm_s=speed,
        code=np.where(doses, DWELL, moves.code),
        pause_s=np.where(doses, toolpath.duration_s[moves.move], moves.pause_s),
    )


def _flow(printer: Printer, load: HeadLoad) -> float:
    if load.flow_ul_s is None:
        raise ToolpathError(
            f"{printer.name} has a pneumatic head, and nobody said its flow (flow_ul_s, µL/s): "
            "give it, measured or foreseen (firmware_profiles.steady_flow)"
        )
    return load.flow_ul_s


def _written_way(moves: MachineMoves, printer: Printer, first: FloatArray) -> FloatArray:
    """Way of each command as its text will say it, (n, 3): rounding is part of the length."""
    digits = decimals_for(printer)
    scale = 10.0 ** np.array([digits.x, digits.y, digits.z])
    return np.diff(np.rint(np.vstack([first, moves.position[:, :3]]) * scale), axis=0) / scale


def _of(toolpath: Toolpath, move: int) -> str:
    x, y, z = toolpath.end[move].tolist()
    number = int(toolpath.source[move])
    return f"{toolpath.source_kind} {number}, to ({x:.3f}, {y:.3f}, {z:.3f}) mm of the part"


def _refuse_dry(toolpath: Toolpath, moves: MachineMoves, dry: NDArray[np.bool_]) -> None:
    if dry.any():
        raise ToolpathError(
            f"{_of(toolpath, int(moves.move[dry.argmax()]))} writes without ink; a pneumatic head "
            "lays ink whenever it writes: make it a travel"
        )


def _refuse_beyond(
    toolpath: Toolpath,
    printer: Printer,
    moves: MachineMoves,
    way: FloatArray,
    load: HeadLoad,
) -> None:
    """Speeds that an axis or the ink doesn't bear; the first of each sort is named."""
    length = np.linalg.norm(way, axis=1)
    writes = (toolpath.kind[moves.move] == MoveKind.WRITE) & (length > 0)
    share = np.divide(np.abs(way), length[:, None], out=np.zeros_like(way), where=writes[:, None])
    low, high = load.ink_speed_mm_s or (0.0, np.inf)
    limits = [
        (moves.speed_mm_s * share[:, k], 0.0, limit, f"max_speed_mm_s.{axis}")
        for k, (axis, limit) in enumerate(
            zip("xyz", per_axis(printer.max_speed_mm_s)[:3].tolist(), strict=True)
        )
    ]
    for speed, least, most, key in [
        *limits,
        (moves.speed_mm_s, low, high, "the ink's write_speed_mm_s"),
    ]:
        wrong = writes & ((speed > most * (1 + ROUNDING)) | (speed < least * (1 - ROUNDING)))
        if wrong.any():
            row = int(wrong.argmax())
            raise ToolpathError(
                f"{_of(toolpath, int(moves.move[row]))}: at {load.flow_ul_s:.4g} µL/s it must "
                f"be written at {moves.speed_mm_s[row]:.4g} mm/s; its {speed[row]:.4g} mm/s are "
                f"outside {least:g} to {most:g} mm/s ({printer.name}: {key}), in "
                f"{int(wrong.sum())} moves; change the pressure, the needle or the line's width"
            )


def valve_lines(
    toolpath: Toolpath,
    table: Table,
    heads: Sequence[Pneumatic],
    marks: Marks,
    dialect: Dialect,
    *,
    standing_doses: bool,
) -> Marks:
    """Return the valves' commands and the marks, each before its row of the table.

    A valve closes before a mark (where the job may be interrupted) and opens after it.
    """
    known = table.move >= 0
    kind = np.where(known, toolpath.kind[np.maximum(table.move, 0)], -1)
    doses = (kind == MoveKind.PRIME) & standing_doses
    flows = (kind == MoveKind.WRITE) | doses
    before, after = np.roll(flows, 1), np.roll(flows, -1)
    before[:1], after[-1:] = False, False
    interrupted = np.isin(np.arange(len(kind)), marks.row)
    opens = np.flatnonzero(flows & (~before | doses | interrupted))
    closes = np.flatnonzero(flows & (~after | doses | np.roll(interrupted, -1))) + 1
    shut = [_switch(head, dialect, to_open=False) for head in heads]
    opened = [_switch(head, dialect, to_open=True) for head in heads]
    return in_order(
        _lines_at(closes, table.head[closes - 1], shut),
        marks,
        _lines_at(opens, table.head[opens], opened),
    )


def _lines_at(rows: IntArray, heads: NDArray[np.int8], lines: Sequence[list[str]]) -> Marks:
    """Lines of each row's head before the row."""
    each = [lines[head] for head in heads.tolist()]
    text = [line for of_row in each for line in of_row]
    return Marks(np.repeat(rows, [len(of_row) for of_row in each]), text)


def _switch(head: Pneumatic, dialect: Dialect, *, to_open: bool) -> list[str]:
    """Wait for the motors, switch, wait for the valve."""
    delay = head.opening_delay_s if to_open else head.closing_delay_s
    pause = [dialect.dwell(delay)] if delay > 0 else []
    enables = [head.enables] if to_open and head.enables else []
    return [dialect.waits, *enables, head.opens if to_open else head.closes, *pause]
