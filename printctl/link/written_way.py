"""Length of the way that a job writes, counted at places between its lines."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sim.reading import is_motion, read_sent


def written_mm(lines: Sequence[bytes], places: Sequence[int]) -> list[float]:
    """Return the way of the moves before each of ``places`` that push the plunger, mm.

    Of a job that never moves the plunger (a pneumatic head's), the way of all moves along X and Y.
    Straight lengths are counted, of an arc its chord.

    Parameters
    ----------
    lines : sequence of bytes
        The job's.
    places : sequence of int
        Command lines before each; ascending.
    """
    by_plunger = any(b" E" in line and is_motion(line) for line in lines)
    at, total = dict.fromkeys("XYZE", 0.0), 0.0
    found = list[float]()
    for index, line in enumerate(lines):
        while len(found) < len(places) and places[len(found)] <= index:
            found.append(total)
        before = dict(at)
        if is_motion(line) or line.startswith(b"G92 "):
            words = read_sent(line).words
            at |= {axis: mm for axis, mm in words.items() if axis in at and mm is not None}
        if is_motion(line):
            aside = math.dist([before["X"], before["Y"]], [at["X"], at["Y"]])
            writes = at["E"] > before["E"] if by_plunger else aside > 0
            way = math.dist([before[axis] for axis in "XYZ"], [at[axis] for axis in "XYZ"])
            total += way if writes else 0.0
    return [*found, *[total] * (len(places) - len(found))]
