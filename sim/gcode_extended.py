"""Klipper's commands with names, put into the words that the one G-code reader knows.

``SET_KINEMATIC_POSITION X=1 Y=2`` says where the tip stands, as G92 does for other firmwares, and
is read as that; ``ACTIVATE_EXTRUDER EXTRUDER=extruder1`` is T1. ``SET_IDLE_TIMEOUT`` and the rest
move nothing and become M105, which only asks; their names and words are handed on to be judged.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

_LINE: Final = re.compile(rb"^[ \t]*([A-Za-z]+_\w+|STATUS)\b([^;\r\n]*)", re.MULTILINE)
_WORD: Final = re.compile(rb"\b([XYZ])=([+-]?[\d.]+)")
_VALUE: Final = re.compile(rb"(\w+)=(\S+)")
_CHOSEN: Final = re.compile(rb"\bEXTRUDER=extruder(\d*)\b")
CHOOSES: Final = "ACTIVATE_EXTRUDER"
PLACES: Final = "SET_KINEMATIC_POSITION"
OFFSETS: Final = "SET_GCODE_OFFSET"
NOTHING: Final = b"M105"


@dataclass(frozen=True)
class Named:
    """A command with a name: its line, from 1, and its words."""

    line: int
    name: str
    words: dict[str, str]


def plain_command(name: bytes, words: bytes) -> bytes:
    """One named command in G-code."""
    chosen = _CHOSEN.search(words) if name.decode().upper() == CHOOSES else None
    if chosen is not None:
        return b"T" + (chosen[1] or b"0")
    if name.decode().upper() != PLACES:
        return NOTHING
    return b" ".join([b"G92", *(axis + value for axis, value in _WORD.findall(words.upper()))])


def without_names(gcode: bytes) -> tuple[bytes, tuple[Named, ...]]:
    """Replace named commands in a file, and say which they were."""
    found: list[Named] = []
    seen = line = 0

    def plain(match: re.Match[bytes]) -> bytes:
        nonlocal seen, line
        line += gcode.count(b"\n", seen, match.start())
        seen = match.start()
        words = {
            key.decode().upper(): value.decode("ascii", "replace")
            for key, value in _VALUE.findall(match[2])
        }
        found.append(Named(line + 1, match[1].decode().upper(), words))
        return plain_command(match[1], match[2])

    return _LINE.sub(plain, gcode), tuple(found)
