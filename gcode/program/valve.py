"""Valve commands of pneumatic heads in a G-code file, and the state of each valve row by row.

Which commands those are the profile says (`dispenser`: opens, closes); a line is one of them if
it has the same command and words, in any order. The same command with the same address (what both
have in common, a pin or a fan) and another value leaves the valve somewhere between; it is
reported as that, and counts as open.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from gcode.errors import LineError
from gcode.program.gcode import Program, parse_line
from gcode.program.modal import MOVE
from gcode.reading.line import GcodeLine, Lines, output_of, refusal
from kernels.arrays import FloatArray, IntArray

UNKNOWN, CLOSED, OPEN, BETWEEN = range(-1, 3)
"""States of a valve."""
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

    def of_rows(self, rows: NDArray[np.bool_]) -> Valve:
        """Return the valve as some of the program's rows see it, (n,)."""
        if not rows.any():
            none = np.zeros(0, np.int64)
            return Valve(none, none, none)
        earlier: IntArray = np.cumsum(rows) - rows
        return Valve(np.minimum(earlier[self.row], rows.sum() - 1), self.state, self.before[rows])

    @staticmethod
    def joined(valves: Sequence[Valve]) -> Valve:
        """Return what all valves do together: open where one of them is."""
        if len(valves) == 1:
            return valves[0]
        row = np.concatenate([one.row for one in valves])
        order = np.argsort(row, kind="stable")
        state = np.concatenate([one.state for one in valves])[order]
        before = np.max([one.before for one in valves], axis=0)
        return Valve(row[order], state, np.asarray(before, np.int64))


def read_valves(program: Program, others: Lines, printer: Printer) -> tuple[Valve, ...]:
    """Find the lines that switch each head's valve, of a file's lines that aren't moves."""
    return tuple(read_switch(program, others, head.opens, head.closes) for head in printer.airs)


def read_switch(program: Program, others: Lines, on: str, off: str) -> Valve:
    """Find the lines that switch something by one command with two values.

    Parameters
    ----------
    program, others
        As for `read_valves`.
    on, off : str
        After which it is OPEN, or CLOSED.
    """
    opens, closes = _command(on), _command(off)
    row_of = first_rows(program)
    rows: list[int] = []
    states: list[int] = []
    for number, line in others:
        state = UNKNOWN
        if line.code == opens[0]:
            state = _state((line.code, _words(line)), opens, closes)
        if state != UNKNOWN and number in row_of:
            rows.append(row_of[number])
            states.append(state)
    row, state_of = np.array(rows, np.int64), np.array(states, np.int64)
    latest = np.searchsorted(row, np.arange(len(program)), side="left") - 1
    before = np.where(latest >= 0, np.append(state_of, UNKNOWN)[latest], UNKNOWN)
    return Valve(row, state_of, before)


SETS_PRESSURE: Final = "SETS_PRESSURE"
"""Name of a translated command that sets the pressure of HEAD to KPA."""


def read_pressures(others: Lines, printer: Printer) -> tuple[tuple[int, int, float], ...]:
    """Find the lines that set a head's pressure; line, head and kPa, infinite where unclear."""
    pairs = {k: tuple(map(_command, pair)) for k, pair in printer.pressure_pairs.items()}
    found = []
    for number, line in others:
        if line.code == SETS_PRESSURE:
            found.append((number, int(line.parameters["HEAD"]), float(line.parameters["KPA"])))
            continue
        for head, (none, most) in pairs.items():
            if line.code == none[0] and none[1] & most[1] <= _words(line):
                greatest = printer.airs[head].max_pressure_kpa
                found.append((number, head, greatest * _share(_words(line), none[1], most[1])))
    return tuple(found)


def _share(given: Words, none: Words, most: Words) -> float:
    """Share of the greatest pressure that words set; infinite where they say anything else."""
    low, high = dict(none - most), dict(most - none)
    rest = dict(given - (none & most))
    if rest.keys() != high.keys():
        return math.inf
    try:
        ((key, top),) = high.items()
        return (float(rest[key]) - float(low[key])) / (float(top) - float(low[key]))
    except ValueError:
        return math.inf


def first_rows(program: Program) -> dict[int, int]:
    """Return the first row of each line of the file."""
    return dict(zip(program.line.tolist()[::-1], range(len(program) - 1, -1, -1), strict=True))


def _words(line: GcodeLine) -> Words:
    if line.is_named:
        return frozenset(line.parameters.items())
    return frozenset(
        (letter, "" if value is None else value) for letter, value in line.words.items()
    )


def _command(text: str) -> tuple[str, Words]:
    """Name and words of a profile's command, whichever way it is written."""
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


def read_lifts(
    program: Program, others: Lines, printer: Printer
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Find where each head is surely raised, and where a command has said so or not, (n, heads).

    A fixed one is never raised, and needs no command.
    """
    raised = np.zeros((len(program), printer.head_count), dtype=np.bool_)
    commanded = np.ones_like(raised)
    for number, head in enumerate(printer.heads or ()):
        if head.raises is not None and head.lowers is not None:
            switch = read_switch(program, others, head.lowers, head.raises)
            raised[:, number] = switch.before == CLOSED
            commanded[:, number] = (switch.before == OPEN) | (switch.before == CLOSED)
    return raised, commanded


_LEVEL_MM: Final = 1e-6


def with_heads(
    program: Program, axis_mm: FloatArray, lifted_mm: FloatArray, valves: Sequence[Valve]
) -> tuple[Program, tuple[tuple[int, LineError], ...]]:
    """Say which head is in use row by row, and give the program that head's height.

    Between two openings of different valves the head changes where both stand at one height:
    where first at the greatest such.

    Parameters
    ----------
    program : Program
    axis_mm : (n, heads) float64, mm
        Each head's axis after each row.
    lifted_mm : (n, heads) float64, mm
        How much a lift raises each during each row.
    valves : sequence of Valve

    Returns
    -------
    program : Program
    refused : tuple of (int, LineError)
        Openings before which they never stand at one height.
    """
    switches = sorted(
        (row, state, head)
        for head, valve in enumerate(valves)
        for row, state in zip(valve.row.tolist(), valve.state.tolist(), strict=True)
    )
    stands = axis_mm + lifted_mm
    tool, closed, refused = np.zeros(len(program), dtype=np.int64), 0, []
    active: int | None = None
    for row, state, head in switches:
        if state == CLOSED:
            closed = row if head == active else closed
            continue
        if active is None:
            tool[:] = head
        elif head != active:
            new, old = stands[closed:row, head], stands[closed:row, active]
            height = np.where(np.abs(new - old) <= _LEVEL_MM, new, -np.inf)
            level = bool(np.isfinite(height).any())
            tool[closed + int(height.argmax()) + 1 if level else row :] = head
            if not level:
                refused.append((int(program.line[row]), _uneven(head, active)))
        active = head
    target = program.target.copy()
    target[:, 2] = axis_mm[np.arange(len(program)), tool]
    return replace(program, tool=tool, target=target), tuple(refused)


def with_other_axes(program: Program, axis_mm: FloatArray, printer: Printer) -> Program:
    """Give each move the time that the vertical axes of heads not in use take.

    F is the speed along the way of all axes together. Where only such an axis moves, the row's
    `value` is its time, from standing to standing; else its feed is lowered.

    Parameters
    ----------
    axis_mm : (n, heads) float64, mm
        As for `with_heads`.
    """
    step = np.abs(np.diff(axis_mm, axis=0, prepend=np.full_like(axis_mm[:1], program.start[2])))
    step[np.arange(len(program)), program.tool] = 0.0
    moves = (program.kind == MOVE) & step.any(axis=1)
    own = np.linalg.norm((program.target - program.before)[moves, :3], axis=1)
    way = np.hypot(own, np.linalg.norm(step[moves], axis=1))
    top = printer.max_speed_mm_s.z * way / step[moves].max(axis=1)
    speed = np.minimum(program.feed[moves], top)
    ramp = min(printer.acceleration_mm_s2, printer.max_acceleration_mm_s2.z)
    seconds = np.where(way * ramp > speed**2, way / speed + speed / ramp, 2 * np.sqrt(way / ramp))
    alone = own <= _LEVEL_MM
    feed, value = program.feed.copy(), program.value.copy()
    feed[moves] = np.where(alone, feed[moves], speed * own / way)
    value[moves] = np.where(alone, seconds, np.nan)
    return replace(program, feed=feed, value=value)


def idle_outside(
    program: Program, axis_mm: FloatArray, printer: Printer
) -> tuple[tuple[int, LineError], ...]:
    """Refuse the first row that takes a head not in use beyond its vertical axis' travel.

    ``axis_mm`` as for `with_heads`.
    """
    span, refused = printer.z_mm, []
    for head, height in enumerate(axis_mm.T):
        beyond = (height < span.low - _LEVEL_MM) | (height > span.high + _LEVEL_MM)
        rows = np.flatnonzero(beyond & (program.tool != head))
        if len(rows):
            reason = (
                f"{printer.z_axes[head]}, the axis of head {head}, goes to {height[rows[0]]:g} mm, "
                f"outside {span.low:g} to {span.high:g} mm ({printer.name}: z_mm)"
            )
            refused.append((int(program.line[rows[0]]), refusal("outside_z", b"", reason)))
    return tuple(refused)


def _uneven(head: int, before: int) -> LineError:
    return refusal(
        "ambiguous", b"", f"the valve of head {head} opens, and its vertical axis and that of head "
        f"{before} never stood at one height since: raise both to one height where the head changes"
    )  # fmt: skip
