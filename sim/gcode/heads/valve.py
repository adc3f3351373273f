"""Find a pneumatic head's valve commands in G-code, and the times of ink flow.

Which commands those are the profile says (`dispenser`: opens, closes); a line is one of them if it
has the same command and words, in any order. The same command with the same address (what both
have in common, a pin or a fan) and another value leaves the valve somewhere between; it is told as
that, and counts as open.

Ink flows from the opening delay after an opening until the closing delay after a closing. When that
was follows from the blocks that ran between the two commands and from the dwells beside them; the
time that a line takes to come isn't in it. Pressure and flow are taken as steady meanwhile: no
rise, no lag of the ink, no oozing from a closed valve.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Pneumatic, Printer
from kernels.arrays import FloatArray, IntArray
from sim.errors import GcodeError, LineError
from sim.gcode.motion.executed import ExecutedMotion
from sim.gcode.program.gcode import Program, parse_line
from sim.gcode.program.modal import DWELL
from sim.gcode.program.read_program import read_written
from sim.gcode.reading.named_commands import NamedCommand
from sim.gcode.reading.outputs import output_of

OPEN: Final = 1
CLOSED: Final = 0
BETWEEN: Final = 2
UNKNOWN: Final = -1
_CODE: Final = re.compile(rb"[GMT]\d+")

Words = frozenset[tuple[str, str | float]]


@dataclass(frozen=True)
class Valve:
    """Valve states along a G-code file.

    Attributes
    ----------
    row : (k,) int64
        Rows of the program that switch it.
    state : (k,) int64
        OPEN, CLOSED or BETWEEN after each.
    before : (n,) int64
        State while each row of the program is done; UNKNOWN until the first switch.
    """

    row: IntArray
    state: IntArray
    before: IntArray

    @property
    def is_open(self) -> NDArray[np.bool_]:
        """Whether ink may flow during each row, (n,)."""
        open_rows: NDArray[np.bool_] = (self.before == OPEN) | (self.before == BETWEEN)
        return open_rows


def read_valve(
    program: Program, gcode: bytes, named: tuple[NamedCommand, ...], head: Pneumatic
) -> Valve:
    """Find the lines that switch the valve.

    Parameters
    ----------
    program : Program
    gcode : bytes
        What it was read from, Klipper's commands with names as they came or not.
    named : tuple of NamedCommand
        Klipper's commands with names.
    head : Pneumatic
    """
    return read_switch(program, gcode, named, head.opens, head.closes)


def read_switch(
    program: Program, gcode: bytes, named: tuple[NamedCommand, ...], on: str, off: str
) -> Valve:
    """Find the lines that switch something by one command with two values.

    Parameters
    ----------
    program, gcode, named
        As for `read_valve`.
    on, off : str
        After which it is OPEN, or CLOSED.
    """
    opens, closes = _command(on), _command(off)
    lines = gcode.splitlines()
    row_of = dict(zip(program.line.tolist()[::-1], range(len(program) - 1, -1, -1), strict=True))
    by_name = {at.line: (at.name, frozenset(at.words.items())) for at in named}
    name = opens[0].encode()
    plain = [n for n, text in enumerate(lines, 1) if text.lstrip()[: len(name)] == name]
    numbers = sorted(
        {*plain, *(n for n, (command, _) in by_name.items() if command.encode() == name)}
    )
    rows, states = [], []
    for line in numbers:
        command = by_name.get(line) or _command(
            lines[line - 1].partition(b";")[0].decode("latin-1")
        )
        state = _state(command, opens, closes)
        if state != UNKNOWN and line in row_of:
            rows.append(row_of[line])
            states.append(state)
    row, state_of = np.array(rows, np.int64), np.array(states, np.int64)
    latest = np.searchsorted(row, np.arange(len(program)), side="left") - 1
    before = np.where(latest >= 0, np.append(state_of, UNKNOWN)[latest], UNKNOWN)
    return Valve(row, state_of, before)


def read_with_valve(
    gcode: bytes, printer: Printer, start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Program, Valve | None]:
    """A file's commands, and the valve in it where the printer has one.

    Parameters
    ----------
    gcode : bytes
    printer : Printer
    start_mm : tuple, mm
        Where the tip stands before the first line.

    Raises
    ------
    GcodeError
        When a command can't be read: what is left of the file would be another part.
    """
    program, text, named, refused = read_written(gcode, printer, start_mm)
    refuse_unread(refused)
    head = printer.pneumatic
    return program, None if head is None else read_valve(program, text, named, head)


def refuse_unread(refused: Sequence[tuple[int, LineError]]) -> None:
    """Raise `GcodeError` with the first of the lines that can't be read, if there are any."""
    if refused:
        line, error = refused[0]
        raise GcodeError(
            f"line {line}: {error} ({len(refused)} lines can't be read; `printctl simulate` tells "
            "them by kind)"
        )


def _command(text: str) -> tuple[str, Words]:
    """Name and words of a command, whichever way it is written."""
    output = output_of(text)
    if output is not None:
        return output[0], frozenset(output[1].items())
    first, *rest = text.split()
    if _CODE.fullmatch(first.encode()):
        parsed = parse_line(text.encode("latin-1"))
        words: Words = frozenset({*parsed.values.items(), *((flag, "") for flag in parsed.flags)})
        return parsed.name, words
    pairs = (word.partition("=") for word in rest)
    return first.upper(), frozenset((key.upper(), value) for key, _, value in pairs)


def _state(command: tuple[str, Words], opens: tuple[str, Words], closes: tuple[str, Words]) -> int:
    """What a command makes of the valve; UNKNOWN where it is about something else."""
    if command == opens:
        return OPEN
    if command == closes:
        return CLOSED
    same = command[0] == opens[0] and opens[1] & closes[1] <= command[1]
    return BETWEEN if same else UNKNOWN


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
    valve : Valve
    head : Pneumatic
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
