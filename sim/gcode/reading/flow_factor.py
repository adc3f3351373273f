"""Multiply plunger travel of writing moves in job lines by a factor.

Only moves that write are changed: those that push the plunger on a way of the tip. What moves the
plunger alone (drawing back, priming) keeps its length. The count of E goes on from where it was; a
line that counts the plunger anew (G92 E) stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from sim.gcode.reading.sent_line import is_motion, plunger_word

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
