"""Signs that a G-code file is incomplete, or was written for another kind of printer.

Three things that a firmware executes without complaint: E words that extrude nothing, a last line
that was cut, and a tip that stays in the printed material when the file ends.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcode.program.gcode import Program
from gcode.program.modal import MOVE
from gcode.reading.line import Finding

_SAME_MM: Final = 1e-6
_ROUNDED_UNITS: Final = 2.0
"""Units of E's last digit that rounding may take from a move."""
_E_WORD: Final = re.compile(rb"[Ee][ \t]*([+-]?\d*\.?\d*)")
_UNFINISHED: Final = re.compile(rb"(?:[A-Za-z]|[.+-])\Z")
_MOVING: Final = re.compile(rb"[ \t]*(?:[Nn]\d+[ \t]*)?[Gg]0*[0-3](?!\d)")


def completeness_findings(
    program: Program,
    doses: NDArray[np.bool_],
    gcode: bytes,
    file: bytes,
    *,
    pneumatic: bool,
    lift_mm_s: float,
) -> list[Finding]:
    """Return what shows that the file isn't whole, or isn't meant for a plunger.

    Parameters
    ----------
    program : Program
        The file's commands.
    doses : (n,) bool
        Rows that extrude.
    gcode : bytes
        The text that ``program`` was read from, line by line.
    file : bytes
        The file as it is.
    pneumatic : bool
        Whether valves extrude, so that E means nothing.
    lift_mm_s : float, mm/s
        Speed of the lift that is proposed where the tip stays down.
    """
    down = _tip_left_down(program, doses, lift_mm_s)
    found = [*_cut_line(program, file, bool(down)), *down]
    return found if pneumatic else [*_idle_e_words(program, gcode), *found]


def _tip_left_down(program: Program, doses: NDArray[np.bool_], lift_mm_s: float) -> list[Finding]:
    moves = program.kind == MOVE
    across = np.abs(program.target - program.before)[:, :2].max(axis=1, initial=0.0) > _SAME_MM
    lines = moves & doses & across
    if not lines.any():
        return []
    top = float(program.target[lines, 2].max())
    last = int(np.flatnonzero(moves)[-1])
    end = float(program.target[last, 2])
    if end > top + _SAME_MM:
        return []
    line = int(program.line[last])
    return [
        Finding(
            line,
            "left_down",
            f"line {line}: the file ends with the tip at Z {end:g} mm, but extrudes up to Z "
            f"{top:g} mm: the needle would stay in the print; add a lift at the end (such as G0 "
            f"Z{top + 5:g} F{60 * lift_mm_s:g}), or export the file again if its end is missing",
            end,
            top,
        )
    ]


def _cut_line(program: Program, file: bytes, left_down: bool) -> list[Finding]:
    """A last line without a line end, where it breaks off in a word or before the lift."""
    if not file or file[-1:] in (b"\n", b"\r") or not len(program):
        return []
    last = re.split(rb"\r\n|\n|\r", file)[-1].partition(b";")[0].rstrip()
    if not (_MOVING.match(last) and (left_down or _UNFINISHED.search(last))):
        return []
    line = int(program.line[-1])
    shown = last.decode("ascii", "backslashreplace")
    return [
        Finding(
            line,
            "cut_off",
            f"line {line}: the file ends in the middle of a line ({shown!r} without a line end), "
            "as after an interrupted copy or export; copy or export it again",
        )
    ]


def _idle_e_words(program: Program, gcode: bytes) -> list[Finding]:
    """Moves with an E word that leaves the plunger where it is, too long to be rounding."""
    length = np.linalg.norm((program.target - program.before)[:, :3], axis=1)
    pushed = program.pushed
    extrudes = (program.kind == MOVE) & (pushed > 0) & (length > 0)
    lines = gcode.splitlines()
    if not extrudes.any():
        return _nothing_extruded(program, length > _SAME_MM, lines)
    idle = (program.kind == MOVE) & (np.abs(pushed) <= 1e-12) & (length > 0)
    rows = np.array(list(_with_e_word(program, idle, lines)), dtype=np.int64)
    if not len(rows):
        return []
    per_mm = float(pushed[extrudes].sum() / length[extrudes].sum())
    digit = _last_digit(lines[int(program.line[k]) - 1] for k in rows[:50])
    wrong = rows[length[rows] * per_mm > _ROUNDED_UNITS * digit]
    if not len(wrong):
        return []
    line = int(program.line[wrong[0]])
    return [
        Finding(
            line,
            "idle_e",
            f"line {line}: {len(wrong)} moves ({length[wrong].sum():.4g} mm) have an E word but "
            "extrude nothing, as E is absolute (M82) and already at that value; either E should "
            "be relative (add M83), or E1 means \N{LEFT DOUBLE QUOTATION MARK}valve open"
            "\N{RIGHT DOUBLE QUOTATION MARK} on the printer that the file was made for: export it "
            "for this printer",
            count=len(wrong),
        )
    ]


def _nothing_extruded(
    program: Program, travels: NDArray[np.bool_], lines: list[bytes]
) -> list[Finding]:
    """A file without any line of ink: its E words must be meant for another kind of printer.

    Doses at a standstill are a file of their own kind (drops, a weighing), but for E words of 0
    and 1 alone with travel at 1, which open and close a valve.
    """
    moves = program.kind == MOVE
    numbers = sorted({int(line) for line in program.line[moves]})
    words = {number: word for number in numbers if (word := _e_value(lines, number))}
    along = sorted(set(words) & {int(line) for line in program.line[moves & travels]})
    open_travel = moves & travels & (program.target[:, 3] == 1.0)
    if open_travel.any() and {float(word) for word in words.values()} == {0.0, 1.0}:
        line = next(number for number, word in words.items() if float(word))
        why = (
            "E only takes the values 0 and 1, as on a printer whose E1 opens a valve; here E is "
            "plunger travel in mm"
        )
    elif along:
        line = along[0]
        why = (
            f"{len(along)} moves have an E word, but it never increases (E is absolute, M82); it "
            "may be meant as relative, or with the opposite sign"
        )
    else:
        return []
    text = f"line {line}: no move of the file extrudes: {why}; export it for this printer"
    return [Finding(line, "idle_e", text, count=max(1, len(along)))]


def _e_value(lines: list[bytes], number: int) -> bytes:
    """Return the number of a line's E word; empty without one."""
    if number > len(lines):
        return b""
    word = _E_WORD.search(lines[number - 1].partition(b";")[0])
    return word[1] if word is not None and word[1].strip(b"+-.") else b""


def _with_e_word(program: Program, idle: NDArray[np.bool_], lines: list[bytes]) -> Iterator[int]:
    """Rows of ``idle`` whose line has an E word other than 0, arcs once."""
    before = 0
    for row in np.flatnonzero(idle).tolist():
        number = int(program.line[row])
        if number == before or number > len(lines):
            continue
        before = number
        word = _E_WORD.search(lines[number - 1].partition(b";")[0])
        if word is not None and word[1].strip(b"+-0.") != b"":
            yield row


def _last_digit(lines: Iterator[bytes]) -> float:
    """Return the value of E's last digit, mm, by the longest fraction among ``lines``.

    Nobody rounds E to less than a hundredth: shorter words are written so on purpose.
    """
    words = (_E_WORD.search(line) for line in lines)
    places = [len(word[1].partition(b".")[2]) for word in words if word is not None]
    return float(10.0 ** -max(2, *places, 0))
