"""Job lines with their doses multiplied by a factor, as a correction of the flow wants them.

Only moves that write are changed: those that push the plunger on a way of the tip. What moves the
plunger alone (drawing back, priming) keeps its length. The count of E goes on from where it was; a
line that counts the plunger anew (G92 E) stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from sim.reading.sent_line import code_of, is_motion, read_sent

LEAST: Final = 0.5
MOST: Final = 2.0
"""Of the file's own doses."""


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
    found = list(lines)
    for index, line in enumerate(lines):
        if b" E" not in line:
            continue
        moves = is_motion(line)
        if not moves and code_of(line) != b"G92":
            continue
        read = read_sent(line)
        to = read.number("E")
        if to is None:
            continue
        if not moves:
            was = now = to
            continue
        writes = to > was and not read.words.keys().isdisjoint("XYZ")
        now += (to - was) * (factor if writes else 1.0)
        was = to
        found[index] = _with_e(line, now)
    return found


def plunger_count(lines: Sequence[bytes]) -> float:
    """Return the plunger's count after some lines of a job, mm; 0 where none tells it."""
    for line in reversed(lines):
        if b" E" in line and (is_motion(line) or code_of(line) == b"G92"):
            e_mm = read_sent(line).number("E")
            if e_mm is not None:
                return e_mm
    return 0.0


def _with_e(line: bytes, e_mm: float) -> bytes:
    words = line.split(b" ")
    return b" ".join(b"E%.5f" % e_mm if word[:1] == b"E" else word for word in words)
