"""Parse G-code lines in the form sent to the printer, already rendered by `read_line`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from firmware_profiles.families.grammar import TEXT_CODES
from sim.gcode.reading.line import BLANK, GcodeLine
from sim.gcode.reading.read import PLAIN_MOVE, plain_move

_CODE: Final = re.compile(rb"[GMT]\d+")
_NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?")
MOTION_LINES: Final = (b"G0", b"G1", b"G2", b"G3")


def read_sent(text: bytes) -> GcodeLine:
    """Read a line as it is sent; `BLANK` for an empty one.

    Parameters
    ----------
    text : bytes
        The ``text`` of a `GcodeLine`, or one of our own commands, written in the same way.
    """
    plain = PLAIN_MOVE.fullmatch(text)
    return plain_move(plain) if plain is not None else _read(text)


def code_of(text: bytes) -> bytes:
    """Code of a line as it is sent, without reading its words."""
    return text.partition(b" ")[0]


def is_motion(text: bytes) -> bool:
    """Whether a line as it is sent is a move or an arc."""
    return code_of(text) in MOTION_LINES


def plunger_word(text: bytes) -> float | None:
    """Number behind E of a move or a G92, as `read_sent` gives it, in a tenth of its time."""
    begin = text.find(b" E")
    if begin < 0 or not (is_motion(text) or text.startswith(b"G92 ")):
        return None
    word = text[begin + 2 :].partition(b" ")[0]
    return float(word) if _NUMBER.fullmatch(word) else None


@lru_cache(maxsize=4096)
def _read(text: bytes) -> GcodeLine:
    first, *rest = text.split(b" ")
    if not first:
        return BLANK
    code = first.decode("ascii")
    if not _CODE.fullmatch(first):
        pairs = (word.decode("ascii").partition("=") for word in rest)
        return GcodeLine(code, {}, text, {key: value for key, _, value in pairs})
    if code in TEXT_CODES:
        return GcodeLine(code, {}, text)
    words = {
        word[:1].decode("ascii"): float(word[1:]) if _NUMBER.fullmatch(word[1:]) else None
        for word in rest
    }
    return GcodeLine(code, words, text)


# Multiply plunger travel of writing moves in job lines by a factor.
#
# Only moves that write are changed: those that push the plunger on a way of the tip. What moves the
# plunger alone (drawing back, priming) keeps its length. The count of E goes on from where it was;
# a line that counts the plunger anew (G92 E) stays.

LEAST: Final = 0.3
MOST: Final = 3.0
"""Of the file's own doses."""
_ACROSS: Final = (b" X", b" Y", b" Z")


def with_flow(lines: Sequence[bytes], e_mm: float, factor: float) -> list[bytes]:
    """Return lines whose writing moves push ``factor`` times as far.

    Parameters
    ----------
    lines : sequence of bytes
        Of a job, from some place on; E absolute.
    e_mm : float, mm
        The plunger's count before the first.
    factor : float
    """
    was = now = e_mm
    scaled = list(lines)
    for index, line in enumerate(lines):
        to = plunger_word(line)
        if to is None:
            continue
        if not is_motion(line):  # G92
            was = now = to
            continue
        writes = to > was and any(axis in line for axis in _ACROSS)
        now += (to - was) * (factor if writes else 1.0)
        was = to
        scaled[index] = _with_e(line, now)
    return scaled


def plunger_count(lines: Sequence[bytes]) -> float:
    """Return the plunger's count after some lines of a job, mm; 0 where none tells it."""
    for line in reversed(lines):
        e_mm = plunger_word(line)
        if e_mm is not None:
            return e_mm
    return 0.0


def _with_e(line: bytes, e_mm: float) -> bytes:
    before, _, behind = line.partition(b" E")
    _, space, rest = behind.partition(b" ")
    return b"%b E%.5f%b%b" % (before, e_mm, space, rest)
