"""Lines of a file that aren't plain moves: few, and each judged by itself."""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from sim.errors import LineError
from sim.reading.line import GcodeLine
from sim.reading.read import read_line

Others = tuple[tuple[int, GcodeLine], ...]
"""Line of the file, from 1, and what stands there."""

_OTHER: Final = re.compile(rb"^(?!G[01] |;|\s*$).+", re.MULTILINE)
"""Begins otherwise than the writer's moves and comments; `read_line` tells what it is."""
_MOVES: Final = frozenset({"G0", "G1"})


def other_lines(gcode: bytes, printer: Printer) -> Others:
    """Read a file's lines that aren't moves; those that can't be read are left out.

    Parameters
    ----------
    gcode : bytes
    printer : Printer
        Its ``firmware`` says how lines are read.
    """
    found: list[tuple[int, GcodeLine]] = []
    kept: dict[bytes, GcodeLine | None] = {}
    number, counted = 1, 0
    for match in _OTHER.finditer(gcode):
        number, counted = number + gcode.count(b"\n", counted, match.start()), match.start()
        text = match[0]
        if text not in kept:
            kept[text] = _read(text, printer)
        line = kept[text]
        if line:
            found.append((number, line))
    return tuple(found)


def _read(text: bytes, printer: Printer) -> GcodeLine | None:
    """Read one line; None for a move, and for one that is refused elsewhere."""
    try:
        line = read_line(text, printer)
    except LineError:
        return None
    return None if line.code in _MOVES else line
