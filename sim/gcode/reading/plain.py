"""Fast parser for plain moves, which make up most of a G-code file.

Read here without all the questions that other lines are asked; `sim.gcode.reading.read` would read
each of them alike (a test compares the two).
"""

from __future__ import annotations

import re
from typing import Final

from sim.gcode.reading.line import GcodeLine

_NUMBER: Final = rb"(-?\d{1,6}(?:\.\d{1,9})?)"
_FEED: Final = rb"(?: F([1-9]\d{0,5}(?:\.\d{1,9})?))?"
PLAIN_MOVE: Final = re.compile(
    rb"(G[01])"
    + _FEED
    + b"".join(rb"(?: %c" % letter + _NUMBER + b")?" for letter in b"XYZE")
    + rb"(?(2)|"
    + _FEED
    + b")"
)
_LETTERS: Final = ("F", "X", "Y", "Z", "E", "F")


def plain_move(match: re.Match[bytes]) -> GcodeLine:
    """Convert a match of `PLAIN_MOVE` to a move."""
    code, *numbers = match.groups()
    words = {
        letter: float(number)
        for letter, number in zip(_LETTERS, numbers, strict=True)
        if number is not None
    }
    return GcodeLine(code.decode(), words, match[0])
