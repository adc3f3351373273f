"""Translate named commands (Klipper style) to G-code words for the reader.

``SET_KINEMATIC_POSITION X=1 Y=2`` says where the tip stands, as G92 does for other firmwares, and
is read as that; ``ACTIVATE_EXTRUDER EXTRUDER=extruder1`` is T1. ``SET_IDLE_TIMEOUT`` and the rest
move nothing and become M105, which only asks; their names and words are handed on to be judged.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from firmware_profiles.families import meanings
from firmware_profiles.families.grammar import Meaning

_CHOSEN: Final = re.compile(r"extruder(\d*)")
NOTHING: Final = b"M105"


@dataclass(frozen=True)
class NamedCommand:
    """A command with a name: its line, from 1, and its words."""

    line: int
    name: str
    words: dict[str, str]


def plain_command(named: NamedCommand) -> bytes:
    """One named command in G-code."""
    meaning = meanings().get(named.name)
    if meaning is Meaning.CHOOSES:
        chosen = _CHOSEN.fullmatch(named.words.get("EXTRUDER", ""))
        return b"T%d" % int(chosen[1] or 0) if chosen else NOTHING
    if meaning is not Meaning.PLACES:
        return NOTHING
    places = [f"{axis}{named.words[axis]}" for axis in "XYZ" if axis in named.words]
    return " ".join(["G92", *places]).encode() if places else NOTHING
