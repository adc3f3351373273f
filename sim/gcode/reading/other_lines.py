"""Read a G-code file's lines other than straight moves, with their line numbers."""

from __future__ import annotations

from typing import Final

from firmware_profiles import Printer
from sim.encoding import text_of
from sim.errors import LineError
from sim.gcode.reading.faults import MOST_REFUSED
from sim.gcode.reading.line import GcodeLine
from sim.gcode.reading.plain import PLAIN_MOVE
from sim.gcode.reading.read import read_line

Others = tuple[tuple[int, GcodeLine], ...]
"""Line of the file, from 1, and what stands there."""

_MOVES: Final = frozenset({"G0", "G1"})


def other_lines(gcode: bytes, printer: Printer) -> Others:
    """Read a file's lines that aren't moves; those that can't be read are left out.

    After so many of these as `read_file` bears (`MOST_REFUSED`) the rest is left out, too.

    Parameters
    ----------
    gcode : bytes
    printer : Printer
        Its ``firmware`` says how lines are read.
    """
    is_plain = PLAIN_MOVE.fullmatch
    others: list[tuple[int, GcodeLine]] = []
    kept: dict[bytes, GcodeLine | None] = {}
    refused = 0
    for number, text in enumerate(text_of(gcode).splitlines(), 1):
        if is_plain(text) or text[:1] == b";":
            continue
        if text not in kept:
            kept[text] = _read(text, printer)
        line = kept[text]
        if line is None:
            refused += 1
            if refused == MOST_REFUSED:
                break
        elif line and line.code not in _MOVES:
            others.append((number, line))
    return tuple(others)


def _read(text: bytes, printer: Printer) -> GcodeLine | None:
    """Read one line; None for one that is refused elsewhere."""
    try:
        return read_line(text, printer)
    except LineError:
        return None
