"""Convert commands to a table of G-code words as integers; unchanged words are left out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.errors import ToolpathError
from design.toolpath.gcode.commands import DWELL, MachineMoves, per_axis
from firmware_profiles import Printer, ProfileError
from firmware_profiles.families import family_of
from firmware_profiles.families.dialect import WORDS, Dialect
from kernels import jit
from kernels.arrays import FloatArray, IntArray

FLOAT32_WHOLE: Final = 2**24
"""A float32 holds every whole number up to this one."""
_E_DIGITS: Final = 7
"""The most with which a float32 holds a whole millimetre and its last digit; E is counted anew by
whole millimetres. A motor step is several short moves' ink, each of which must still have its own
dose: 0.1 mm of a line 0.15 x 0.06 mm is 5e-5 mm in a bore of 4.61 mm."""


@dataclass(frozen=True)
class Decimals:
    """Digits after the point for X, Y, Z and E.

    Positions have three, or as many as make the last digit finer than a quarter of a motor step.
    """

    x: int
    y: int
    z: int
    e: int
    # Largest push of one move, mm: so large an E still has, in a float32, a quarter of the first
    # digit finer than a quarter of a motor step.
    e_move_mm: float


def decimals_for(printer: Printer) -> Decimals:
    """Digits that the printer's steps need."""
    steps = printer.steps_per_mm
    return Decimals(
        x=max(3, _digits(steps.x)),
        y=max(3, _digits(steps.y)),
        z=max(3, _digits(steps.z)),
        e=_E_DIGITS,
        e_move_mm=FLOAT32_WHOLE / 8 / 10 ** _digits(steps.e),
    )


def _digits(steps_per_mm: float) -> int:
    """Fewest digits whose quantum is below a quarter of a step."""
    return max(0, math.floor(math.log10(4.0 * steps_per_mm)) + 1)


def dialect_of(printer: Printer) -> Dialect:
    """Return the dialect of the printer's firmware.

    Raises
    ------
    ToolpathError
        When there is none, or the profile doesn't say enough to choose it.
    """
    try:
        return family_of(printer).dialect(printer)
    except ProfileError as exc:
        raise ToolpathError(f"no G-code can be written: {exc}") from exc


_X, _Y, _Z, E_WORD, _F, _P = range(6)
_SET = 92
_NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Table:
    """Commands ``G<code>`` with words."""

    code: IntArray  # (n,)
    value: IntArray  # (n, 6), X, Y, Z, E, F and P, each in its last digit
    given: NDArray[np.bool_]  # (n, 6), whether the word is written
    source: IntArray  # (n,), as in `Gcode`
    move: IntArray  # (n,)
    head: NDArray[np.int8]  # (n,), whose letters the words have

    def of(self, head: int) -> Table:
        """Return the same rows as another head's."""
        return replace(self, head=np.full(len(self.code), head, np.int8))

    def where(self, rows: IntArray | NDArray[np.bool_]) -> Table:
        """Return the rows of a mask or of row numbers."""
        return Table(**{name: column[rows] for name, column in vars(self).items()})

    @staticmethod
    def joined(parts: Sequence[Table]) -> Table:
        """Return the rows of tables one after another."""
        names = vars(parts[0])
        return Table(**{n: np.concatenate([getattr(one, n) for one in parts]) for n in names})


_NOTHING = Table(
    _NONE,
    np.zeros((0, 6), dtype=np.int64),
    np.zeros((0, 6), dtype=np.bool_),
    _NONE,
    _NONE,
    np.zeros(0, dtype=np.int8),
)


@dataclass(frozen=True)
class JobPosition:
    """Where a job stands between two parts of its toolpath."""

    # (4,), X, Y, Z and the plunger's travel since the job's begin, each in its last digit
    quanta: IntArray
    feed: int = -1  # F of the last move, in its last digit; -1 before the first
    base: int = 0  # what E's counting anew has taken off the plunger's travel, in its last digit

    @staticmethod
    def at(position: FloatArray, printer: Printer) -> JobPosition:
        """The begin of a job, ``position`` (4,) in mm."""
        return JobPosition(_quanta(position[None], decimals_for(printer))[0])

    def position(self, printer: Printer) -> FloatArray:
        """The same in mm, (4,)."""
        return np.asarray(self.quanta / _scale(decimals_for(printer)))


def counted_from(reached: JobPosition, printer: Printer) -> tuple[Table, JobPosition]:
    """Count E from where a head's plunger stands, less whole mm; the row, and what is reached.

    Whole millimetres are whole motor steps, as where E is counted anew in mid-run: no part of a
    step is lost at a change of head.
    """
    whole = 10 ** decimals_for(printer).e
    travel = int(reached.quanta[E_WORD])
    base = travel // whole * whole
    words = np.zeros((1, 4), dtype=np.int64)
    words[0, E_WORD] = travel - base
    row = _with_sets(_NOTHING, np.zeros(1, np.int64), words, position=False, plunger=True)
    return row, JobPosition(reached.quanta, reached.feed, base)


def tabulate(
    commands: MachineMoves, reached: JobPosition, printer: Printer, *, blind: bool = False
) -> tuple[Table, JobPosition]:
    """Words of a part of a job's commands, and where the job stands after them.

    A command that changes nothing in the last digit is left out; positions are absolute, so the
    next one makes up for it. With ``blind`` the tip's place is unknown: then the first
    command gives Z alone and the second X and Y.

    Raises
    ------
    ToolpathError
        When one move pushes more than E can hold.
    """
    digits = decimals_for(printer)
    quanta = _quanta(commands.position, digits)
    changed = np.diff(quanta, axis=0, prepend=reached.quanta[None]) != 0
    if blind:
        changed[0] = [False, False, True, False]
        changed[1] = [True, True, False, False]
    dwells = (commands.code == DWELL) & (np.rint(commands.pause_s * 1e3) > 0)
    kept = changed.any(axis=1) | dwells
    commands, changed = commands.where(kept), changed[kept]
    value = np.zeros((len(commands.code), 6), dtype=np.int64)
    given = np.zeros((len(commands.code), 6), dtype=np.bool_)
    value[:, :4], given[:, :4] = quanta[kept], changed
    value[:, _F] = _feeds(commands, reached, printer, digits)
    moves = np.flatnonzero(commands.code != DWELL)
    given[moves, _F] = np.diff(value[moves, _F], prepend=reached.feed) != 0
    value[:, _P] = np.rint(commands.pause_s * 1e3).astype(np.int64)
    given[:, _P] = commands.code == DWELL
    feed = int(value[moves[-1], _F]) if len(moves) else reached.feed
    head = np.zeros(len(commands.code), dtype=np.int8)
    table, base = Table(commands.code, value, given, commands.source, commands.move, head), 0
    if not printer.pneumatic and dialect_of(printer).counts_anew:
        table, base = _counted_anew(table, reached, digits)
    return table, JobPosition(quanta[-1] if len(quanta) else reached.quanta, feed, base)


def declare_position(table: Table, begin: JobPosition, *, position: bool, plunger: bool) -> Table:
    """Put the G92 in front that says where the tip stands, and that E is 0."""
    if not (position or plunger):
        return table
    first = np.zeros(1, dtype=np.int64)
    return _with_sets(table, first, begin.quanta[None], position=position, plunger=plunger)


def declare_height(begin: JobPosition) -> Table:
    """Return the G92 that says at which height an axis stands, that of ``begin``."""
    row = _with_sets(
        _NOTHING, np.zeros(1, np.int64), begin.quanta[None], position=True, plunger=False
    )
    return replace(row, given=row.given & (np.arange(6) == _Z))


def place_text(begin: JobPosition, printer: Printer) -> tuple[str, str, str]:
    """Where the tip stands at the begin, as the moves round it: X, Y, Z."""
    digits = decimals_for(printer)
    places = (digits.x, digits.y, digits.z)
    x, y, z = (
        f"{quanta / 10**place:.{place}f}"
        for quanta, place in zip(begin.quanta[:3].tolist(), places, strict=True)
    )
    return x, y, z


def _quanta(position: FloatArray, digits: Decimals) -> IntArray:
    """Positions in their last digit, (n, 4); each rounded by itself, so nothing accumulates."""
    return np.rint(position * _scale(digits)).astype(np.int64)


def _scale(digits: Decimals) -> FloatArray:
    return 10.0 ** np.array([digits.x, digits.y, digits.z, digits.e])


def _feeds(
    commands: MachineMoves, reached: JobPosition, printer: Printer, digits: Decimals
) -> IntArray:
    """F of each command in its last digit, never above an axis' limit.

    A move steep in Z or rich in ink goes slower as a whole, so its path and its ink per length
    stay as they are. What counts is the way as written, which rounding may have tilted. Rounded
    down, but never to nothing.
    """
    scale = _scale(digits)
    written = np.diff(_quanta(commands.position, digits), axis=0, prepend=reached.quanta[None])
    change = np.abs(written) / scale
    length = np.linalg.norm(change[:, :3], axis=1)
    # Where only the plunger moves, F is the plunger's.
    length = np.where(length > 0, length, change[:, 3])
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = per_axis(printer.max_speed_mm_s) * length[:, None] / change
    limit[change == 0] = np.inf
    speed = np.minimum(commands.speed_mm_s, limit.min(axis=1))
    dialect = dialect_of(printer)
    quanta = np.floor(speed * dialect.feed_s * 10.0**dialect.feed_decimals * (1 + 1e-9))
    return np.maximum(quanta, 1).astype(np.int64)


def _counted_anew(table: Table, reached: JobPosition, digits: Decimals) -> tuple[Table, int]:
    """Count E anew (G92) before float32 loses its last digit; and the last base.

    Only whole millimetres are taken away: whole motor steps on a printer with whole steps per
    mm, so that the firmware's own rounding loses nothing either.
    """
    travel = np.append(reached.quanta[E_WORD], table.value[:, E_WORD])
    rows, bases = _rebase(travel, reached.base, digits)
    value = table.value.copy()
    taken = np.zeros(len(value), dtype=np.int64)
    taken[:1] = reached.base
    taken[rows] += np.diff(bases, prepend=reached.base)
    value[:, E_WORD] -= np.cumsum(taken)
    shifted = replace(table, value=value)
    words = np.zeros((len(rows), 4), dtype=np.int64)
    words[:, E_WORD] = travel[rows] - bases
    counted = _with_sets(shifted, rows, words, position=False, plunger=True)
    return counted, int(bases[-1]) if len(bases) else reached.base


def _rebase(travel: IntArray, base: int, digits: Decimals) -> tuple[IntArray, IntArray]:
    """Rows before which E is counted anew, and what is taken away from there on.

    ``travel`` (n + 1,) is the plunger's before the first row and after each. A long push leaves E
    above the limit: its last digit is lost, which is little of so large a dose.
    """
    limit, whole = FLOAT32_WHOLE, 10**digits.e
    rows: list[int] = []
    bases: list[int] = []
    row = 0
    while len(over := np.flatnonzero(np.abs(travel[row + 1 :] - base) > limit)):
        row += int(over[0])
        before, after = int(travel[row]), int(travel[row + 1])
        base = before // whole * whole
        if abs(after - base) > digits.e_move_mm * whole:
            raise ToolpathError(
                f"one move pushes the plunger by {(after - before) / whole:.3f} mm; E holds at "
                f"most {digits.e_move_mm:.3f} mm at a time in the firmware's float32; "
                "write it in several moves"
            )
        rows.append(row)
        bases.append(base)
        row += 1
    return np.array(rows, dtype=np.int64), np.array(bases, dtype=np.int64)


def _with_sets(
    table: Table, rows: IntArray, words: IntArray, *, position: bool, plunger: bool
) -> Table:
    """Insert G92 lines before ``rows`` with X, Y, Z, E of ``words`` (r, 4)."""
    value = np.pad(words, ((0, 0), (0, 2)))
    given = np.zeros((len(rows), 6), dtype=np.bool_)
    given[:, E_WORD] = plunger
    given[:, [_X, _Y, _Z]] = position
    return Table(
        np.insert(table.code, rows, _SET),
        np.insert(table.value, rows, value, axis=0),
        np.insert(table.given, rows, given, axis=0),
        np.insert(table.source, rows, -1),
        np.insert(table.move, rows, -1),
        np.insert(table.head, rows, 0),
    )


# A value is counted in its last digit (``12.345`` with three decimals is 12345), so that text is
# exact and nothing depends on how floats are printed.
Bytes = NDArray[np.uint8]
CHUNK: Final = 2**16
"""Rows rendered at a time: a buffer of 10 MB."""
ROW_BYTES: Final = len(WORDS) * len(" X-0.123456789012345678") + len("G92\n")
"""Longest text of a row: each word a blank, a letter, a sign, 19 digits and a point."""


@jit
def _number(text: Bytes, at: int, value: int, decimals: int) -> int:
    """Write value / 10^decimals without trailing zeros; returns the place after it."""
    if value < 0:
        text[at] = 45
        at += 1
        value = -value
    while decimals > 0 and value % 10 == 0:
        value //= 10
        decimals -= 1
    digits, rest = 1, value // 10
    while rest > 0:
        rest //= 10
        digits += 1
    digits = max(digits, decimals + 1)
    length = digits + (1 if decimals > 0 else 0)
    for k in range(length):
        place = at + length - 1 - k
        if decimals > 0 and k == decimals:
            text[place] = 46
        else:
            text[place] = 48 + value % 10
            value //= 10
    return at + length


@jit
def _render(
    code: IntArray,
    value: IntArray,
    given: NDArray[np.bool_],
    decimals: IntArray,
    head: NDArray[np.int8],
    words: Bytes,
    text: Bytes,
) -> IntArray:
    """Write all rows; returns the end of each. ``words`` (heads, 6) are each head's letters."""
    ends, at = np.empty(len(code), np.int64), 0
    for row in range(len(code)):
        text[at] = 71
        at = _number(text, at + 1, code[row], 0)
        for word in range(words.shape[1]):
            if given[row, word]:
                text[at], text[at + 1] = 32, words[head[row], word]
                at = _number(text, at + 2, value[row, word], decimals[word])
        text[at] = 10
        at += 1
        ends[row] = at
    return ends


def render(
    table: Table,
    decimals: tuple[int, int, int, int, int, int],
    letters: Sequence[bytes] = (WORDS,),
) -> tuple[bytes, int]:
    """Return the commands' text and its longest line in bytes, the line end not counted.

    ``letters`` are those of each head's words.
    """
    words = np.frombuffer(b"".join(letters), dtype=np.uint8).reshape(len(letters), -1)
    text = np.empty(CHUNK * ROW_BYTES, dtype=np.uint8)
    parts, longest = [], 0
    for low in range(0, len(table.code), CHUNK):
        part = table.where(np.arange(low, min(low + CHUNK, len(table.code))))
        rows = (part.code, part.value, part.given)
        ends = _render(*rows, np.array(decimals), part.head, words, text)
        parts.append(text[: ends[-1]].tobytes())
        longest = max(longest, int(np.diff(ends, prepend=0).max()) - 1)
    return b"".join(parts), longest
