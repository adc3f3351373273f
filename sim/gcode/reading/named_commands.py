"""Translate named commands (Klipper style) to G-code words for the reader.

``SET_KINEMATIC_POSITION X=1 Y=2`` says where the tip stands, as G92 does for other firmwares, and
is read as that; ``ACTIVATE_EXTRUDER EXTRUDER=extruder1`` is T1. ``SET_IDLE_TIMEOUT`` and the rest
move nothing and become M105, which only asks; their names and words are handed on to be judged.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from sim.gcode.reading import GcodeLine

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


# Check that a printer's firmware knows a command, by code or by name.
#
# What a machine knows beyond its family's commands its profile names (`extra_commands`).

_CODE: Final = re.compile(r"[GMT]\d+")


def is_known(printer: Printer, name: str) -> bool:
    """Whether the printer's firmware knows a command by its letter and number: ``M104``."""
    grammar = family_of(printer).grammar
    if printer.heads and name in grammar.head_codes:
        return True
    return name.startswith("T") or name in grammar.codes or name in printer.extra_commands


def is_known_name(printer: Printer, name: str) -> bool:
    """Whether the printer's firmware knows a command with a name."""
    names = family_of(printer).grammar.names
    return name in names or name in {other.upper() for other in printer.extra_commands}


def is_known_line(printer: Printer, line: GcodeLine) -> bool:
    """Whether the printer's firmware knows the command of a line that was read."""
    if _CODE.fullmatch(line.code):
        return is_known(printer, line.code)
    grammar = family_of(printer).grammar
    return bool(grammar.named or grammar.names) and is_known_name(printer, line.code)
