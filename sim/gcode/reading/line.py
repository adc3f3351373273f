"""A parsed G-code line, named commands, translated files; refusals and findings of lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import family_of, meanings
from firmware_profiles.families.grammar import Meaning
from sim.errors import LineError
from sim.family_parts import family_part

_NOTHING: Final[Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class GcodeLine:
    """One command.

    Attributes
    ----------
    code : str
        ``G1``, ``M104``, ``T0``, or the name of a Klipper or Aerotech command; empty where the
        line has none.
    words : mapping of str to (float or None)
        Capital letter to number, None for a letter alone (or with a quoted text), as in
        ``G28 X``. In the units of the line.
    text : bytes
        What is sent: capitals, one blank between words, the number's own digits; no line number,
        checksum, comment or line end.
    parameters : mapping of str to str
        Of a command with a name: ``KEY=value``.
    """

    code: str
    words: Mapping[str, float | None]
    text: bytes
    parameters: Mapping[str, str] = field(default_factory=lambda: _NOTHING)

    def __bool__(self) -> bool:
        return bool(self.code)

    def number(self, letter: str) -> float | None:
        """The number behind a letter; None without one."""
        return self.words.get(letter)


BLANK: Final = GcodeLine("", {}, b"")
"""A comment, or nothing."""
_SHOWN: Final = 60
MOST_REFUSED: Final = 1_000
"""Refused lines after which the rest of a file isn't read."""
SORTS: Final[dict[str, str]] = {
    "not_text": "characters that can't be sent",
    "no_command": "lines that aren't a command",
    "bad_comment": "parentheses or quotes that don't close",
    "bad_checksum": "line numbers or checksums that are wrong",
    "bad_code": "codes that firmwares read differently",
    "bad_number": "words without a number that can be read",
    "huge_number": "numbers beyond what a firmware can hold",
    "unknown_word": "words that the firmware doesn't know for this code",
    "unknown_axis": "axes that the machine hasn't",
    "repeated_word": "words that stand twice in a line",
    "too_long": "lines longer than any firmware takes",
    "ambiguous": "words that firmwares read differently",
    "too_many": "places where reading was given up",
}
"""Sort to what it is, in the plural."""


def refusal(sort: str, text: bytes, reason: str) -> LineError:
    """Error for a line; ``sort`` is a key of `SORTS`."""
    shown = text.strip(b"\r\n\t ").decode("ascii", "backslashreplace")
    shown = shown if len(shown) <= _SHOWN else shown[:_SHOWN] + "..."
    return LineError(sort, shown, reason)


@dataclass(frozen=True)
class NamedCommand:
    """A command with a name: its line, from 1, and its words."""

    line: int
    name: str
    words: dict[str, str]


@dataclass(frozen=True)
class TranslatedProgram:
    """A program file in the reader's words.

    Attributes
    ----------
    gcode : bytes
        As many lines as the file.
    named : tuple of NamedCommand
        Outputs that are set, and everything that isn't known.
    per_second : tuple of (int, bool)
        Lines from which on F is told per second, or per minute.
    """

    gcode: bytes
    named: tuple[NamedCommand, ...]
    per_second: tuple[tuple[int, bool], ...]


# Find the translator to G-code of a firmware family whose files are in another language.
#
# A family's folder may hold ``reading.py``, whose ``translate`` puts a file in another language
# into the words of G-code.
Translate = Callable[[bytes, Printer], TranslatedProgram]


def translator_of(printer: Printer) -> Translate | None:
    """Return the translator of a printer's files to G-code; None if they are G-code."""
    module = family_part(printer.firmware, "reading")
    if module is None:
        return None
    translate: Translate = module.translate
    return translate


@dataclass(frozen=True)
class Finding:
    """One sort of problem in a file.

    Attributes
    ----------
    line : int
        Where it is first met, from 1.
    code : str
        Its sort: ``outside_x`` (y, z), ``speed_x`` (y, z, e), ``plunger_travel``,
        ``too_slow``, ``cold_extrusion``, ``unknown_command``, ``no_command``, ``bad_arc``,
        ``homing``, ``long_line``, ``no_such_head``, ``head_not_chosen``, ``plunger_not_counted``,
        ``offset_twice``, ``offset_unknown``, ``empty_file``, or one of
        `sim.gcode.reading.line.SORTS`.
    message : str
        For the user: what, value, limit, remedy.
    value, limit : float
        The worst value and what it should have kept; NaN where there is none.
    count : int
        Rows of the program concerned.
    """

    line: int
    code: str
    message: str
    value: float = float("nan")
    limit: float = float("nan")
    count: int = 1


# Translate named commands (Klipper style) to G-code words for the reader.
#
# ``SET_KINEMATIC_POSITION X=1 Y=2`` says where the tip stands, as G92 does for other firmwares, and
# is read as that; ``ACTIVATE_EXTRUDER EXTRUDER=extruder1`` is T1. ``SET_IDLE_TIMEOUT`` and the rest
# move nothing and become M105, which only asks; their names and words are handed on to be judged.

_CHOSEN: Final = re.compile(r"extruder(\d*)")
NOTHING: Final = b"M105"


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
