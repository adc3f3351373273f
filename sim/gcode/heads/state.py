"""Follow print heads through a G-code file: raised ones, tip positions, doubtful head changes.

A firmware that is told by T which head to use can still do something else than the file's author
meant: T that it doesn't know leaves the old head in use, an offset of its own moves what the file
has moved already, and a count of E that goes on from another plunger's pushes or draws by all the
difference. All that is found here, from the file alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Head, Printer
from firmware_profiles.families import family_of
from kernels.arrays import FloatArray
from sim.gcode.heads.valve import CLOSED, UNKNOWN, Valve, read_switch
from sim.gcode.program.finding import Finding
from sim.gcode.program.gcode import Program, code, parse_line
from sim.gcode.program.modal import SET_POSITION, TOOL
from sim.gcode.reading.named_commands import NamedCommand

_COUNTS: Final = re.compile(rb"E[-+.\d]")


@dataclass(frozen=True)
class Heads:
    """State of the heads while a file is read.

    Attributes
    ----------
    raised : (n, heads) bool
        Whether each head is surely raised during each row of the program; a fixed one never is.
    said : (n, heads) bool
        Whether the file has said it before; always true of a fixed one.
    lift_mm : (heads,) float64, mm
        How much higher each stands when raised.
    offset_mm : (heads, 3) float64, mm
        Of each tip from the first one's, both lowered.
    """

    raised: NDArray[np.bool_]
    said: NDArray[np.bool_]
    lift_mm: FloatArray
    offset_mm: FloatArray

    def tips(self, program: Program, number: int) -> FloatArray:
        """Tip of one head before and after each row, (n, 2, 3), mm, raised or not."""
        ends = program.target[:, :3]
        begins = program.before[:, :3]
        tips = np.stack([begins, ends], axis=1) + self.offset_mm[number]
        tips[:, :, 2] += np.where(self.raised[:, number], self.lift_mm[number], 0.0)[:, None]
        return np.asarray(tips)


def read_heads(
    program: Program, gcode: bytes, named: tuple[NamedCommand, ...], printer: Printer
) -> Heads:
    """Follow the commands that raise and lower heads; parameters as for `valve.read_switch`."""
    heads = printer.heads or ()
    count = printer.head_count
    raised = np.zeros((len(program), count), dtype=np.bool_)
    commanded = np.ones((len(program), count), dtype=np.bool_)
    for number, head in enumerate(heads):
        if (switch := _switch(program, gcode, named, head)) is not None:
            raised[:, number] = switch.before == CLOSED
            commanded[:, number] = switch.before != UNKNOWN
    offset = np.array([head.offset_mm.mm for head in heads] or [(0.0, 0.0, 0.0)])
    lift = np.array([head.raised_mm for head in heads] or [0.0])
    return Heads(raised, commanded, lift, offset)


def _switch(
    program: Program, gcode: bytes, named: tuple[NamedCommand, ...], head: Head
) -> Valve | None:
    if head.raises is None or head.lowers is None:
        return None
    return read_switch(program, gcode, named, head.lowers, head.raises)


def head_findings(program: Program, gcode: bytes, printer: Printer) -> list[Finding]:
    """What a firmware would make of the file's changes of head that its author can't have meant."""
    findings = _no_such_head(program, printer)
    if printer.head_count == 1:
        return findings
    lines = gcode.splitlines()
    return [
        *findings,
        *_unchosen(program),
        *_uncounted(program, lines),
        *_offsets(program, lines, printer),
    ]


def _no_such_head(program: Program, printer: Printer) -> list[Finding]:
    known = [code(f"T{number}") for number in range(printer.head_count)]
    first, last = code("T0"), code("T99999")
    where = (program.code >= first) & (program.code <= last) & ~np.isin(program.code, known)
    return _one(
        program,
        where,
        "no_such_head",
        f"chooses a head that {printer.name} hasn't (0 to {printer.head_count - 1}): the "
        "firmware would go on with the one before, and its syringe be pushed for the other",
    )


def _unchosen(program: Program) -> list[Finding]:
    """Plunger moves before the first T: which head was left in use nobody knows."""
    chosen = np.cumsum(program.kind == TOOL) > 0
    return _one(
        program,
        (program.pushed != 0) & ~chosen,
        "head_not_chosen",
        "moves a plunger before the file has chosen a head; an earlier job may have left another "
        "in use: begin the file with T0",
    )


def _uncounted(program: Program, lines: list[bytes]) -> list[Finding]:
    """Plunger moves after a change of head without a G92 E between."""
    changes = (program.kind == TOOL) & (np.diff(program.tool, prepend=0) != 0)
    counts = np.zeros(len(program), dtype=np.bool_)
    for row in np.flatnonzero(program.kind == SET_POSITION).tolist():
        counts[row] = bool(_COUNTS.search(lines[int(program.line[row]) - 1].upper()))
    at = np.arange(len(program))
    last_change = np.maximum.accumulate(np.where(changes, at, -1))
    last_count = np.maximum.accumulate(np.where(counts, at, -1))
    return _one(
        program,
        (program.pushed != 0) & (last_change > last_count),
        "plunger_not_counted",
        "moves a plunger after a change of head without G92 E between: firmwares go on counting "
        "from the other plunger, or from 0; say G92 E behind each T",
    )


def _offsets(program: Program, lines: list[bytes], printer: Printer) -> list[Finding]:
    """Offsets that the firmware would add to places which have them already."""
    own = family_of(printer).heads
    if own is None or not own.offset_code:
        return []
    command, word = own.offset_code, own.offset_word
    rows = np.flatnonzero(program.code == code(command)).tolist()
    words = {row: parse_line(lines[int(program.line[row]) - 1]).values for row in rows}
    twice = np.zeros(len(program), dtype=np.bool_)
    cleared: dict[int, int] = {}
    for row, values in words.items():
        if word not in values and own.offset_needs_word:
            continue
        values_given = [values[axis] for axis in "XYZ" if axis in values]
        twice[row] = any(values_given)
        if len(values_given) == 3 and not any(values_given):
            cleared.setdefault(int(values.get(word, program.tool[row])), row)
    needed = range(own.first_offset, printer.head_count)
    unsaid = np.zeros(len(program), dtype=np.bool_)
    for row in np.flatnonzero(program.kind == TOOL).tolist():
        number = int(program.tool[row])
        unsaid[row] = number in needed and cleared.get(number, len(program)) > row
    remedy = f"{command} {word}1 X0 Y0 Z0"
    return [
        *_one(
            program,
            twice,
            "offset_twice",
            "gives the firmware an offset of a head, which the places in the file have taken off "
            f"already (profile: heads, offset_mm): the needle would go wrong by it; say {remedy}",
        ),
        *_one(
            program,
            unsaid,
            "offset_unknown",
            "chooses a head whose offset the firmware may keep from its settings; say it is none "
            f"before ({remedy}): the places in the file have it taken off already",
        ),
    ]


def _one(program: Program, where: NDArray[np.bool_], sort: str, text: str) -> list[Finding]:
    if not where.any():
        return []
    line = int(program.line[int(where.argmax())])
    return [Finding(line, sort, f"line {line} {text}", count=int(where.sum()))]
