"""Read a G-code file into a table of moves with modal state resolved, or one line into words.

`read_gcode` takes a whole file in one compiled pass (about a million lines a second) and gives
moves with all modal state resolved; `parse_line` takes one line for those who answer it. Both
rest on the same two kernels, `gcode.program.modal.split_words` and
`gcode.program.modal.interpret`.

Read are G0 to G4 (arcs in the xy plane, cut into segments), G20, G21, G28, G90 to G92, M82, M83,
M220, M221, the waits M0, M1, M109, M190, M400, and T where there are several heads. All other
commands come as they stand, to be
judged by their code. A comment begins at a semicolon.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from firmware_profiles.families.grammar import ERule
from gcode.motion.state import Record, Records
from gcode.program.modal import (
    ARC,
    BAD,
    DWELL,
    HOME,
    MOVE,
    WORDS,
    arc_is_sound,
    arc_points,
    dwell_s,
    has_word,
    interpret,
    new_modal,
    speed,
    split_words,
)
from gcode.user_files import text_of
from kernels import jit
from kernels.arrays import FloatArray, IntArray

NO_COMMAND: Final = 0
"""Code of a line that isn't a command."""
_LETTER: Final = 1_000_000


def code(command: str) -> int:
    """Number under which `Program.code` holds a command: ``code("G92")``."""
    return ord(command[0]) * _LETTER + int(command[1:])


def code_name(number: int) -> str:
    """Turn `code` back: ``G92``."""
    if number == NO_COMMAND:
        return "no command"
    letter, rest = divmod(number, _LETTER)
    return f"{chr(letter)}{rest}"


@dataclass(frozen=True)
class Command:
    """Parsed G-code command.

    Attributes
    ----------
    letter : str
        G, M or T; empty where the line is no command.
    line_number : int or None
        The N word.
    values : dict of str to float
        Words with a number.
    flags : frozenset of str
        Letters without one.
    text : bytes
        From the command's letter on, without checksum where there is a command.
    """

    letter: str
    number: int
    line_number: int | None
    values: dict[str, float]
    flags: frozenset[str]
    text: bytes

    @property
    def name(self) -> str:
        """Letter and number: ``G92``."""
        return f"{self.letter}{self.number}"

    @property
    def words(self) -> frozenset[str]:
        """All letters, with a number or without."""
        return self.flags | self.values.keys()


def parse_line(line: bytes) -> Command:
    """Take one line apart; a comment and the line end may still be there."""
    text = line.partition(b";")[0].rstrip(b"\r\n")
    words = np.zeros(1, WORDS)
    split_line(text, words)
    return command_of(text, words)


def command_of(text: bytes, words: Records) -> Command:
    """Python's view of ``words``, (1,) of `WORDS`, that `split_words` made of ``text``."""
    row = words[0]
    valued, seen = int(row["valued"]), int(row["seen"])
    letters = [(chr(65 + k), k) for k in range(26) if seen >> k & 1]
    shown = text[int(row["begin"]) :]
    letter = chr(int(row["letter"])) if row["letter"] else ""
    if letter:
        head, star, _ = shown.partition(b"*")
        shown = head.rstrip(b" ") if star else head
    return Command(
        letter=letter,
        number=int(row["number"]),
        line_number=int(row["numbered"]) if row["numbered"] >= 0 else None,
        values={name: float(row["value"][k]) for name, k in letters if valued >> k & 1},
        flags=frozenset(name for name, k in letters if not valued >> k & 1),
        text=shown,
    )


def checksum(line: bytes) -> int:
    """XOR of all bytes: what follows the ``*``."""
    value = int.from_bytes(line, "little")
    width = 8 * len(line)
    while width > 8:
        half = (width // 8 + 1) // 2 * 8
        value = (value >> half) ^ (value & ((1 << half) - 1))
        width = half
    return value


@dataclass(frozen=True)
class Program:
    """A file's commands with all modal state resolved; an arc is a row per segment.

    Attributes
    ----------
    line : (n,) int64
        Line of the file, from 1.
    command : (n,) int64
        Which command it is, from 0: comments and empty lines don't count, as they aren't sent.
    code : (n,) int64
        As `code` gives it.
    kind : (n,) int64
        Of its effect: `MOVE`, `ARC`, … of `gcode.program.modal`.
    target : (n, 4) float64, mm
        Firmware's native x, y, z, e after the command.
    plunger : (n,) float64, mm
        Travel of the head's plunger since the start, which G92 doesn't move.
    tool : (n,) int64
        The head that E moves, after the command.
    feed : (n,) float64, mm/s
        Asked for.
    value : (n,) float64
        Seconds of a dwell, or of a move that only the axis of a head not in use makes; the S (else
        R, else P) word of a command that doesn't move. Else NaN.
    length : (n,) int64, bytes
        Of the command without comment, line number and checksum.
    start : (4,) float64, mm
        Before the first command.
    """

    line: IntArray
    command: IntArray
    code: IntArray
    kind: IntArray
    target: FloatArray
    plunger: FloatArray
    tool: IntArray
    feed: FloatArray
    value: FloatArray
    length: IntArray
    start: FloatArray

    def __len__(self) -> int:
        return len(self.line)

    @property
    def before(self) -> FloatArray:
        """Where each row begins: the target of the row before, (n, 4), mm."""
        return np.vstack([self.start[None, :], self.target])[: len(self)]

    @property
    def pushed(self) -> FloatArray:
        """How far each row drives its head's plunger, (n,), mm; below 0 where it draws back."""
        # Neither a change of head nor a new count moves a plunger; both may round.
        return np.where(self.kind == MOVE, np.diff(self.plunger, prepend=0.0), 0.0)

    @property
    def columns(self) -> Columns:
        """The columns alone, as kernels take them."""
        return Columns(*(getattr(self, name) for name in Columns._fields))

    def of_head(self, number: int) -> Program:
        """The rows of one head alone."""
        rows = self.tool == number
        kept = {name: column[rows] for name, column in self.columns._asdict().items()}
        return Program(**kept, start=self.start)


class Columns(NamedTuple):
    """`Program`'s columns, for kernels."""

    line: IntArray
    command: IntArray
    code: IntArray
    kind: IntArray
    target: FloatArray
    plunger: FloatArray
    tool: IntArray
    feed: FloatArray
    value: FloatArray
    length: IntArray

    @staticmethod
    def of(room: int) -> Columns:
        """Room for so many rows, for `_read` to fill."""
        line, command, code_, kind, tool, length = (np.empty(room, np.int64) for _ in range(6))
        plunger, feed, value = (np.empty(room) for _ in range(3))
        target = np.empty((room, 4))
        return Columns(line, command, code_, kind, target, plunger, tool, feed, value, length)


def read_gcode(
    gcode: bytes,
    start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    heads: int = 1,
    e_rule: ERule = "with_axes",
) -> Program:
    """Read a whole file.

    Parameters
    ----------
    start_mm : tuple, mm
        Where the tip stands before the first line.
    heads : int
        How many the printer has (`firmware_profiles.Printer.head_count`); T says nothing to one
        with a single head.
    e_rule : str
        What makes E relative (`firmware_profiles.families.grammar.Grammar`).

    Raises
    ------
    GcodeError
        For bytes that aren't text, such as a NUL.
    """
    gcode = text_of(gcode)
    room = gcode.count(b"\n") + gcode.count(b"\r") + 1
    while True:
        columns = Columns.of(room)
        used = _read(gcode, new_modal(start_mm, heads, e_rule), np.zeros(1, WORDS), columns)
        if used <= room:
            break
        room = used
    rows = {name: column[:used] for name, column in columns._asdict().items()}
    return Program(**rows, start=np.array([*start_mm, 0.0]))


@jit
def split_line(text: bytes, words: Records) -> None:
    """`gcode.program.modal.split_words` of a whole line, into (1,) of `WORDS`."""
    split_words(text, 0, len(text), words[0])


@jit
def _read(text: bytes, modal_of: Records, words_of: Records, rows: Columns) -> int:
    """Fill ``rows`` as far as they reach; returns how many there are."""
    modal = modal_of[0]
    words = words_of[0]
    segments = np.empty((64, 4))
    begin = np.empty(4)
    used = 0
    line = 0
    command = -1
    at = 0
    size = len(text)
    while at < size:
        line += 1
        end = at
        stop = -1
        while end < size and text[end] != 10 and text[end] != 13:
            if text[end] == 59 and stop < 0:
                stop = end
            end += 1
        stop = end if stop < 0 else stop
        split_words(text, at, stop, words)
        at = end + 1
        if end + 1 < size and text[end] == 13 and text[end + 1] == 10:
            at += 1
        while stop > words.begin and (text[stop - 1] == 32 or text[stop - 1] == 9):
            stop -= 1
        if words.begin >= stop:
            continue
        command += 1
        begin[:] = modal.position
        kind = interpret(modal, words)
        count = 1
        if kind == ARC:
            count = 0
            if arc_is_sound(begin, modal.position, words, modal.unit):
                count = arc_points(begin, modal.position, words, modal.unit, segments)
            if count > len(segments):
                segments = np.empty((count, 4))
                arc_points(begin, modal.position, words, modal.unit, segments)
            if count <= 0:
                kind = BAD
                count = 1
                modal.position[:] = begin
        elif kind == HOME:
            _home(modal, words)
        for k in range(count):
            if used < len(rows.line):
                rows.line[used] = line
                rows.command[used] = command
                rows.code[used] = 0
                if words.letter > 0:
                    rows.code[used] = words.letter * _LETTER + words.number
                rows.kind[used] = MOVE if kind == ARC else kind
                target = rows.target[used]
                for axis in range(4):
                    target[axis] = segments[k, axis] if kind == ARC else modal.position[axis]
                rows.plunger[used] = target[3] + modal.plunger_shift
                rows.tool[used] = modal.tool
                rows.feed[used] = speed(modal)
                rows.value[used] = _value(words, kind)
                rows.length[used] = stop - words.begin if k == 0 else 0
            used += 1
    return used


@jit
def _value(words: Record, kind: int) -> float:
    if kind == DWELL:
        return dwell_s(words)
    if kind in (MOVE, ARC):
        return np.nan
    if has_word(words, 18):
        return words.value[18]
    if has_word(words, 17):
        return words.value[17]
    return words.value[15] if has_word(words, 15) else np.nan


@jit
def _home(modal: Record, words: Record) -> None:
    """Homed axes read zero; none named means all three."""
    named = words.seen >> 23 & 7
    for axis in range(3):
        if named == 0 or (named >> axis) & 1:
            modal.position[axis] = 0.0
            modal.shift[axis] = 0.0
