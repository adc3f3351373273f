"""Print heads as a G-code file uses them: selection, tip positions, valves of pneumatic heads.

Goes in: a program. Comes out: the head in use, tip positions and open valves, row by row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Pneumatic, Printer
from firmware_profiles.families import family_of
from gcode.errors import GcodeError, LineError
from gcode.motion.executed import ExecutedMotion
from gcode.program.gcode import Program, code
from gcode.program.modal import DWELL, MOVE, SET_POSITION, TOOL
from gcode.program.read_program import read_written
from gcode.program.valve import CLOSED, Valve, first_rows, read_lifts, read_valves
from gcode.reading.line import Finding, Lines
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Heads:
    """State of the heads while a file is read.

    A firmware that gets a T for the head to use can still do something else than the file's author
    meant: T that it doesn't know leaves the old head in use, an offset of its own moves what the
    file has moved already, and a count of E that goes on from another plunger's pushes or draws by
    all the difference. All that is found here, from the file alone.

    Attributes
    ----------
    raised : (n, heads) bool
        Whether each head is surely raised during each row of the program; a fixed one never is.
    commanded : (n, heads) bool
        Whether the file has raised or lowered it before, by the profile's commands and no value
        between; always true of a fixed one.
    lift_mm : (heads,) float64, mm
        How much higher each stands when raised.
    offset_mm : (heads, 3) float64, mm
        Of each tip from the first one's, both lowered.
    axis_mm : (n, heads) float64 or None, mm
        Where each head's vertical axis stands after each row; None where a command chooses
        the head.
    """

    raised: NDArray[np.bool_]
    commanded: NDArray[np.bool_]
    lift_mm: FloatArray
    offset_mm: FloatArray
    axis_mm: FloatArray | None = None

    def tips(self, program: Program, number: int) -> FloatArray:
        """Tip of one head before and after each row, (n, 2, 3), mm, raised or not."""
        ends = program.target[:, :3]
        begins = program.before[:, :3]
        tips = np.stack([begins, ends], axis=1) + self.offset_mm[number]
        if self.axis_mm is not None:
            own = np.append(program.start[2], self.axis_mm[:, number])
            tips[:, :, 2] = np.column_stack([own[:-1], own[1:]]) + self.offset_mm[number, 2]
        tips[:, :, 2] += np.where(self.raised[:, number], self.lift_mm[number], 0.0)[:, None]
        return np.asarray(tips)


def read_heads(
    program: Program, others: Lines, printer: Printer, axis_mm: FloatArray | None = None
) -> Heads:
    """Follow the commands that raise and lower heads; parameters as for `read_switch`."""
    heads = printer.heads or ()
    raised, commanded = read_lifts(program, others, printer)
    offset = np.array([head.offset_mm.mm for head in heads] or [(0.0, 0.0, 0.0)])
    lift = np.array([head.raised_mm for head in heads] or [0.0])
    return Heads(raised, commanded, lift, offset, axis_mm)


def head_findings(program: Program, others: Lines, printer: Printer) -> list[Finding]:
    """What a firmware would make of the file's changes of head that its author can't have meant."""
    findings = _no_such_head(program, printer)
    if printer.tool_count == 1:
        return findings
    return [
        *findings,
        *_unchosen(program),
        *_uncounted(program, others),
        *_offsets(program, others, printer),
    ]


def _no_such_head(program: Program, printer: Printer) -> list[Finding]:
    known = [code(f"T{number}") for number in range(printer.tool_count)]
    first, last = code("T0"), code("T99999")
    where = (program.code >= first) & (program.code <= last) & ~np.isin(program.code, known)
    return first_finding(
        program,
        where,
        "no_such_head",
        f" selects a head that {printer.name} doesn't have (0 to {printer.tool_count - 1}): the "
        "firmware would keep the previous head and move its plunger instead",
    )


def _unchosen(program: Program) -> list[Finding]:
    """Plunger moves before the first T: which head is in use is unknown."""
    chosen = np.cumsum(program.kind == TOOL) > 0
    return first_finding(
        program,
        (program.pushed != 0) & ~chosen,
        "head_not_chosen",
        " moves a plunger before a head is selected; an earlier job may have left another one "
        "active: start the file with T0",
    )


def _uncounted(program: Program, others: Lines) -> list[Finding]:
    """Plunger moves after a change of head without a G92 E between."""
    changes = (program.kind == TOOL) & (np.diff(program.tool, prepend=0) != 0)
    counting = [number for number, line in others if "E" in line.values]
    counts = (program.kind == SET_POSITION) & np.isin(program.line, counting)
    at = np.arange(len(program))
    last_change = np.maximum.accumulate(np.where(changes, at, -1))
    last_count = np.maximum.accumulate(np.where(counts, at, -1))
    return first_finding(
        program,
        (program.pushed != 0) & (last_change > last_count),
        "plunger_not_counted",
        " moves a plunger after a head change without G92 E: firmwares keep counting from the "
        "other plunger, or from 0; add G92 E after each T",
    )


def _offsets(program: Program, others: Lines, printer: Printer) -> list[Finding]:
    """Offsets that the firmware would add to places which have them already."""
    family = family_of(printer)
    command, word = family.head_offset_code, family.head_offset_word
    if not command:
        return []
    row_of = first_rows(program)
    words = {row_of[number]: line.values for number, line in others if line.code == command}
    twice = np.zeros(len(program), dtype=np.bool_)
    cleared: dict[int, int] = {}
    for row, values in words.items():
        if word not in values and family.head_offset_needs_word:
            continue
        values_given = [values[axis] for axis in "XYZ" if axis in values]
        twice[row] = any(values_given)
        if len(values_given) == 3 and not any(values_given):
            cleared.setdefault(int(values.get(word, program.tool[row])), row)
    needed = range(family.head_first_offset, printer.head_count)
    unsaid = np.zeros(len(program), dtype=np.bool_)
    for row in np.flatnonzero(program.kind == TOOL).tolist():
        number = int(program.tool[row])
        unsaid[row] = number in needed and cleared.get(number, len(program)) > row
    remedy = f"{command} {word}1 X0 Y0 Z0"
    return [
        *first_finding(
            program,
            twice,
            "offset_twice",
            " sets a head offset in the firmware, but the coordinates in the file already include "
            f"it (profile: heads, offset_mm): the needle would be off by that much; use {remedy}",
        ),
        *first_finding(
            program,
            unsaid,
            "offset_unknown",
            " selects a head whose offset may be stored in the firmware; clear it first "
            f"({remedy}): the coordinates in the file already include it",
        ),
    ]


def first_finding(
    program: Program,
    where: NDArray[np.bool_],
    sort: str,
    text: str,
    value: float = math.nan,
    limit: float = math.nan,
) -> list[Finding]:
    """Return one finding for all rows where something is wrong, with the first one's line."""
    if not where.any():
        return []
    line = int(program.line[int(where.argmax())])
    return [Finding(line, sort, f"line {line}{text}", value, limit, int(where.sum()))]


def read_with_valve(
    gcode: bytes, printer: Printer, start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Program, Valve | None]:
    """Read a file's commands, and what its valves do together where the printer has any.

    Ink flows from the opening delay after an opening until the closing delay after a closing. When
    that was follows from the blocks that ran between the two commands and from the dwells beside
    them; the time that a line takes to come isn't in it. Pressure and flow are taken as steady
    meanwhile: no rise, no lag of the ink, no oozing from a closed valve.

    Parameters
    ----------
    start_mm : tuple, mm
        Where the tip stands before the first line.

    Raises
    ------
    GcodeError
        When a command can't be read: what is left of the file would be another part.
    """
    read = read_written(gcode, printer, start_mm)
    refuse_unread(read.file.refused)
    valves = read_valves(read.program, read.file.others, printer)
    return read.program, Valve.joined(valves) if valves else None


def refuse_unread(refused: Sequence[tuple[int, LineError]]) -> None:
    """Raise `GcodeError` with the first of the lines that can't be read, if there are any."""
    if refused:
        line, error = refused[0]
        raise GcodeError(
            f"line {line}: {error} ({len(refused)} lines can't be read; `printctl simulate` lists "
            "them by type)"
        )


def flowing(
    executed: ExecutedMotion, program: Program, valve: Valve, head: Pneumatic
) -> FloatArray:
    """When ink flowed, (m, 2), s on the printer's clock, ascending and apart.

    An opening during which nothing moves isn't in it, since no block says when it was.

    Parameters
    ----------
    executed : ExecutedMotion
        Of a dry run, or of the simulated printer: its `line` counts commands from 0.
    program : Program
        Of the same file.
    """
    spans: list[list[float]] = []
    for opened, shut in _openings(program, valve):
        blocks = np.flatnonzero((executed.line > opened) & (executed.line < shut))
        if not len(blocks):
            continue
        first, last = int(blocks[0]), int(blocks[-1])
        waits = _dwells(program, opened, int(executed.line[first]))
        begin = float(executed.time_start[first]) - waits + head.opening_delay_s
        waits = _dwells(program, int(executed.line[last]), shut)
        end = float(executed.time_end[last]) + waits + head.closing_delay_s
        if spans and begin <= spans[-1][1]:
            spans[-1][1] = max(end, spans[-1][1])
        elif end > begin:
            spans.append([begin, end])
    return np.array(spans).reshape(-1, 2)


def flowing_s(executed: ExecutedMotion, program: Program, valve: Valve, head: Pneumatic) -> float:
    """How long ink flowed in all, s; openings while nothing moves included."""
    moved = float(np.diff(flowing(executed, program, valve, head), axis=1).sum())
    still = 0.0
    for opened, shut in _openings(program, valve):
        if not ((executed.line > opened) & (executed.line < shut)).any():
            waits = _dwells(program, opened, shut)
            still += max(0.0, waits + head.closing_delay_s - head.opening_delay_s)
    return moved + still


def _openings(program: Program, valve: Valve) -> list[tuple[int, int]]:
    """Commands between which the valve stands open."""
    ends = [*program.command[valve.row].tolist(), int(np.iinfo(np.int64).max)]
    return [
        (ends[k], ends[k + 1]) for k, state in enumerate(valve.state.tolist()) if state != CLOSED
    ]


def _dwells(program: Program, after: int, before: int) -> float:
    """Seconds of dwells between two commands."""
    between = (program.command > after) & (program.command < before) & (program.kind == DWELL)
    return float(program.value[between].sum())


def as_plunger(executed: ExecutedMotion, spans: FloatArray, flow_ul_s: float) -> ExecutedMotion:
    """The same motion with what flowed in place of the plunger, µL: a plunger of 1 mm² bore.

    What flows while nothing moves is laid in a block without length, as a prime is.
    """
    edges = spans.ravel()
    total = np.concatenate([[0.0], np.cumsum(np.diff(spans, axis=1)[:, 0])]) * flow_ul_s
    level = np.column_stack([total[:-1], total[1:]]).ravel()

    def laid(at: FloatArray) -> FloatArray:
        if not len(edges):
            return np.zeros(len(at))
        return np.interp(at, edges, level)

    start, end = laid(executed.time_start), laid(executed.time_end)
    gap = np.flatnonzero(np.append(start[1:], total[-1]) - end > 0) + 1
    at = np.minimum(gap, len(end)) - 1
    return ExecutedMotion(
        start=np.insert(executed.start, gap, executed.end[at], axis=0),
        end=np.insert(executed.end, gap, executed.end[at], axis=0),
        plunger_start=np.insert(start, gap, end[at]),
        plunger_end=np.insert(end, gap, np.append(start[1:], total[-1])[at]),
        time_start=np.insert(executed.time_start, gap, executed.time_end[at]),
        time_end=np.insert(
            executed.time_end, gap, np.append(executed.time_start[1:], edges[-1:])[at]
        ),
        line=np.insert(executed.line, gap, executed.line[at]),
    )


# A printer counts the lines that it is sent, and a host puts in lines of its own (a checkpoint's
# question, a pause), so the count alone doesn't tell the file's command. The places do: blocks end,
# in the file's order, where its moves end, to a motor step, and begin where the last one of the
# file ended; a move that the planner merged into the next has none.
_SAME_PLACE_MM: Final = 0.02
"""A step of a usual axis and the rounding of the text; places differ by more."""
_MAX_SKIPPED_MOVES: Final = 64
"""That may be merged or left out in a row."""


def with_commands(executed: ExecutedMotion, program: Program) -> ExecutedMotion:
    """The motion with each block's `line` the file's command from 0; -1 for a host's own.

    Parameters
    ----------
    program : Program
        Read with the tip where the motion begins.
    """
    rows = np.flatnonzero(program.kind == MOVE)
    target = program.target[rows, :3]
    line = np.full(len(executed), -1, dtype=np.int64)
    at, last = 0, program.start[:3]
    for block, end in enumerate(executed.end):
        if np.abs(executed.start[block] - last).max() > _SAME_PLACE_MM:
            continue
        near = np.abs(target[at : at + _MAX_SKIPPED_MOVES] - end).max(axis=1) <= _SAME_PLACE_MM
        if near.any():
            nearest = at + int(near.argmax())
            line[block] = program.command[rows[nearest]]
            at, last = nearest + 1, target[nearest]
    return replace(executed, line=line)
