"""A parsed G-code line, named commands, translated files; refusals and findings of lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType, ModuleType
from typing import Final, NamedTuple

from firmware_profiles import Printer
from firmware_profiles.families import family_of, find_family, meanings
from firmware_profiles.families.grammar import TEXT, Meaning
from gcode.errors import LineError


@cache
def family_part(family: str, name: str) -> ModuleType | None:
    """Return a simulated firmware family's module (``FAMILY_NAME.py``); None where it has none."""
    module = f"sim.devices.families.{family}_{name}"
    return None if find_spec(module) is None else import_module(module)


_CODE: Final = re.compile(r"[GMT]\d+")
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

    @property
    def is_named(self) -> bool:
        """Whether the command has a name, or is one that only a translator knows."""
        return bool(self.code) and (bool(self.parameters) or not _CODE.fullmatch(self.code))

    @property
    def values(self) -> dict[str, float]:
        """Words with a number."""
        return {letter: value for letter, value in self.words.items() if value is not None}

    def number(self, letter: str) -> float | None:
        """The number behind a letter; None without one."""
        return self.words.get(letter)


BLANK: Final = GcodeLine("", {}, b"")
"""A comment, or nothing."""
Lines = tuple[tuple[int, GcodeLine], ...]
"""Line of the file, from 1, and what stands there."""


class LineLimits(NamedTuple):
    """Limits of what is read."""

    shown_characters: int = 60
    max_refused: int = 1_000  # Refused lines after which the rest of a file isn't read.
    max_digits: int = 15
    # Of a number; a firmware's 32-bit float keeps the last micrometre up to 8 mm only, and its
    # integers end at 2 147 483 647.
    largest: float = 1e6


LIMITS: Final = LineLimits()

SORTS: Final[dict[str, str]] = {
    "not_text": "characters that can't be sent",
    "no_command": "lines that aren't commands",
    "bad_comment": "unclosed parentheses or quotes",
    "bad_checksum": "wrong line numbers or checksums",
    "bad_code": "codes that firmwares interpret differently",
    "bad_number": "words without a valid number",
    "huge_number": "numbers out of the firmware's range",
    "unknown_word": "words unknown to the firmware for this code",
    "unknown_axis": "axes that the printer doesn't have",
    "repeated_word": "words repeated in a line",
    "too_long": "lines longer than any firmware accepts",
    "ambiguous": "words that firmwares interpret differently",
    "undeclared": "lines whose effect depends on the controller's previous state",
    "too_many": "positions where parsing stopped",
    "idle_e": "moves with an E word that extrude nothing",
    "cut_off": "truncated last lines",
    "left_down": "files that end with the tip in the print",
}
"""Sort to what it is, in the plural."""


def refusal(sort: str, text: bytes, reason: str) -> LineError:
    """Error for a line; ``sort`` is a key of `SORTS`."""
    shown = text.strip(b"\r\n\t ").decode("ascii", "backslashreplace")
    shown = (
        shown if len(shown) <= LIMITS.shown_characters else shown[: LIMITS.shown_characters] + "..."
    )
    return LineError(sort, shown, reason)


@dataclass(frozen=True)
class TranslatedProgram:
    """A program file in the reader's words.

    Attributes
    ----------
    gcode : bytes
        As many lines as the file.
    named : tuple of (int, GcodeLine)
        Outputs that are set, and everything that isn't known, by its name.
    per_second : tuple of (int, bool)
        Lines from which on F counts per second, or per minute.
    refused : tuple of (int, LineError)
        Lines that are known, and do something else than the file's author can have meant.
    """

    gcode: bytes
    named: Lines
    per_second: tuple[tuple[int, bool], ...]
    refused: tuple[tuple[int, LineError], ...] = ()


# Find the translator to G-code of a firmware family whose files are in another language.
#
# A family's folder may hold ``reading.py``, whose ``translate`` puts a file in another language
# into the words of G-code.
#
# Of several heads with a vertical axis each, the third argument says whose Z is.
Translate = Callable[[bytes, Printer, int], TranslatedProgram]


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
        `gcode.reading.line.SORTS`.
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


# ``SET_KINEMATIC_POSITION X=1 Y=2`` says where the tip stands, as G92 does for other firmwares, and
# is read as that; ``ACTIVATE_EXTRUDER EXTRUDER=extruder1`` is T1. ``SET_IDLE_TIMEOUT`` and the rest
# move nothing and become M105, which only asks; their names and words are handed on to be judged.
_CHOSEN: Final = re.compile(r"extruder(\d*)")
NOTHING: Final = b"M105"


def plain_command(name: str, parameters: Mapping[str, str]) -> bytes:
    """One named command in G-code."""
    meaning = meanings().get(name)
    if meaning is Meaning.CHOOSES:
        chosen = _CHOSEN.fullmatch(parameters.get("EXTRUDER", ""))
        return b"T%d" % int(chosen[1] or 0) if chosen else NOTHING
    if meaning is not Meaning.PLACES:
        return NOTHING
    places = [f"{axis}{parameters[axis]}" for axis in "XYZ" if axis in parameters]
    return " ".join(["G92", *places]).encode() if places else NOTHING


# What a machine knows beyond its family's commands its profile names (`extra_commands`).
UNKNOWN_REMEDY: Final = (
    "remove it, or list it in the printer profile (extra_commands) if the printer supports it"
)


def is_known(printer: Printer, name: str) -> bool:
    """Whether the printer's firmware knows a command by its letter and number: ``M104``."""
    grammar = family_of(printer).grammar
    if printer.tool_count > 1 and name in grammar.head_codes:
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


# A code that isn't in a family's table takes any well-formed word: whether it may be sent at all is
# decided elsewhere (`gcode.reading.line`).
AXES: Final = frozenset("ABCDHIJKLOQUVWXYZ")
"""Letters that name axes on one machine or another."""
MOTION: Final = frozenset({"G0", "G1", "G2", "G3"})


class AcceptedLetters(NamedTuple):
    """Parameter letters that a code accepts."""

    letters: frozenset[str]
    alone: frozenset[str]
    """Those that need no number."""
    text: bool


@cache
def accepted_letters(family: str, code: str) -> AcceptedLetters | None:
    """Letters of a code; None where any will do."""
    letters = find_family(family).grammar.words.get(code)
    if letters is None:
        return None
    if letters == TEXT:
        return AcceptedLetters(frozenset(), frozenset(), text=True)
    words = letters.split()
    return AcceptedLetters(
        frozenset(word[0] for word in words),
        frozenset(word[0] for word in words if word.endswith("?")),
        text=False,
    )


_WORD: Final = re.compile(
    rb"([A-Za-z])[ \t]*(?:([+-]?)(\d+\.?\d*|\.\d+)|(\"[^\"]*\"))?(?=[ \tA-Za-z]|$)[ \t]*"
)
_EXPONENT: Final = re.compile(rb"[\d.][eE][+-]?\d")
Word = tuple[str, float | None, bytes]
"""Capital letter, number, and the word as it is sent."""


def words_of(rest: bytes, text: bytes, family: str) -> Iterator[Word]:
    """Read what stands behind a code in the line ``text``, word by word.

    Raises
    ------
    LineError
        For anything that isn't a letter with a number, a letter alone or, where the family knows
        them, a letter with a text in quotes.
    """
    _no_exponents(rest, text, family)
    at = len(rest) - len(rest.lstrip(b" \t"))
    while at < len(rest):
        match = _WORD.match(rest, at)
        if match is None:
            raise _not_a_word(rest[at:], text)
        letter = match[1].upper()
        if match[4] is not None:
            if not find_family(family).grammar.quoted_words:
                raise refusal("bad_number", text,
                    f"{letter.decode()} has quoted text, which {family} doesn't accept here; use a "
                    "number")  # fmt: skip
            yield letter.decode(), None, letter + match[4]
        elif match[3] is None:
            yield letter.decode(), None, letter
        else:
            yield letter.decode(), *_number(letter, match[2], match[3], text)
        at = match.end()


def _number(letter: bytes, sign: bytes, digits: bytes, text: bytes) -> tuple[float, bytes]:
    value = float(sign + digits)
    if len(digits) - digits.count(b".") > LIMITS.max_digits or abs(value) > LIMITS.largest:
        raise refusal(
            "huge_number", text,
                f"{(letter + sign + digits[:24]).decode()} has more than {LIMITS.max_digits} "
                f"digits or is beyond ±{LIMITS.largest:.0f}, so firmwares would read a different "
                "number; round it"
        )  # fmt: skip
    shown = b"0" + digits if digits.startswith(b".") else digits.removesuffix(b".")
    return value, letter + (b"-" if sign == b"-" else b"") + shown


def _no_exponents(rest: bytes, text: bytes, family: str) -> None:
    """Refuse 1e-5: a power of ten to some, an E word to others."""
    match = _EXPONENT.search(rest)
    if match is None:
        return
    if find_family(family).grammar.powers_of_ten or b"e" in match[0]:
        raise refusal(
            "bad_number", text,
                f"{match[0].decode()!r} is an exponent to some firmwares and an E word to others; "
                "write the number out, and a space before an E word"
        )  # fmt: skip


def _not_a_word(rest: bytes, text: bytes) -> Exception:
    shown = rest.split()[0].decode("ascii", "backslashreplace")
    if rest[:1] in b"{":
        return refusal("bad_number", text,
            "only the board can evaluate expressions in braces, so they can't be checked; use a "
            "number")  # fmt: skip
    return refusal(
        "bad_number", text, f"{shown!r} isn't a letter with a decimal number (X-1.25); correct it"
    )


WordValues = Mapping[str, float | None]
_HEAD_CODES: Final = ("M104", "M109", "M218", "M221")


def check_meaning(code: str, words: WordValues, family: str, text: bytes) -> None:
    """Refuse a line that can't be meant, or is read in more than one way.

    Raises
    ------
    LineError
        With what is read differently, and what to write instead.
    """
    of_code = _of_motion if code in MOTION else _OTHERS.get(code)
    reason = of_code(words) if of_code else ""
    reason = reason or _of_numbers(code, words, family)
    if reason:
        raise refusal("ambiguous", text, reason)


def _of_motion(words: WordValues) -> str:
    feed = words.get("F")
    if feed is not None and feed <= 0:
        return (
            f"F{feed:g} is ignored by Marlin, an error in Klipper and the slowest feed in "
            "RepRapFirmware; use a positive feed"
        )
    if "R" in words and ("I" in words or "J" in words):
        return (
            "an arc takes a centre (I J) or a radius (R), not both; firmwares differ in which they "
            "use"
        )
    return ""


def _of_dwell(words: WordValues) -> str:
    if len(words) > 1:
        return "G4 has both P and S, of which firmwares use one or add both; keep one"
    if any(value is not None and value < 0 for value in words.values()):
        return "a negative dwell lasts 49 days on Marlin; use a time of at least 0"
    return ""


def _of_count(words: WordValues) -> str:
    if not words:
        return (
            "G92 alone sets every axis to 0 on some firmwares (including the plunger), and none on "
            "others; specify them: G92 X0 Y0 Z0 E0"
        )
    return ""


_OTHERS: Final = {"G4": _of_dwell, "G92": _of_count}


def _of_numbers(code: str, words: WordValues, family: str) -> str:
    head = words.get("T") if code in _HEAD_CODES else None
    if head is not None and (head < 0 or head != int(head)):
        return f"T{head:g} isn't a valid head number; use 0, 1, ..."
    if code in find_family(family).grammar.whole:
        for letter, value in words.items():
            if value is not None and value != int(value):
                return f"{family} truncates {letter}{value:g} to an integer; use an integer"
    return ""


_NAME: Final = re.compile(rb"([A-Za-z][A-Za-z_][A-Za-z0-9_]*)(?:[ \t]+|$)")
_PARAMETER: Final = re.compile(rb"([A-Za-z_][A-Za-z0-9_]*)=(\"[^\"]*\"|[^ \t\"'#=*]+)(?:[ \t]+|$)")
_PLAIN: Final = re.compile(rb"\"([^ \t\"'#=*]+)\"")
_PLACE_NUMBER: Final = re.compile(rb"-?\d{1,6}(?:\.\d{1,9})?")
_PLACING: Final = (Meaning.PLACES, Meaning.SHIFTS)
_PLACES: Final = ("X", "Y", "Z", "X_ADJUST", "Y_ADJUST", "Z_ADJUST")


def named_line(command: bytes, text: bytes) -> GcodeLine | None:
    """Read a command with a name; None where the command has none.

    Raises
    ------
    LineError
        When what follows the name isn't ``KEY=value``, or a key stands twice.
    """
    match = _NAME.match(command)
    if match is None:
        return None
    name, at = match[1].upper(), match.end()
    parameters: dict[str, str] = {}
    parts = [name]
    placing = meanings().get(name.decode()) in _PLACING
    while at < len(command):
        word = _PARAMETER.match(command, at)
        if word is None:
            raise refusal(
                "bad_number", text, f"{command[at:].decode()!r} isn't KEY=value; correct it"
            )
        key = word[1].decode().upper()
        if key in parameters:
            raise refusal("repeated_word", text, f"{key} is repeated; keep one")
        if placing and key in _PLACES and not _PLACE_NUMBER.fullmatch(word[2]):
            raise refusal(
                "bad_number", text,
                    f"{key}={word[2].decode()!r} isn't a decimal number with up to 6 and 9 digits; "
                    "use one"
            )  # fmt: skip
        value = _unquoted(word[2])
        parameters[key] = value.strip(b'"').decode()
        parts.append(key.encode() + b"=" + value)
        at = word.end()
    return GcodeLine(name.decode(), {}, b" ".join(parts), parameters)


def _unquoted(value: bytes) -> bytes:
    """Take the quotes off that mean nothing."""
    match = _PLAIN.fullmatch(value)
    return match[1] if match else value


SETS_ARRAY: Final = "$DO"
SETS_CALL: Final = "DIGITALOUTPUTSET"
SETS_BRAKE: Final = "BRAKE"
SETS_BRAKE_BY_CALL: Final = "DRIVEBRAKE"
OUTPUTS: Final = (SETS_ARRAY, SETS_CALL, SETS_BRAKE, SETS_BRAKE_BY_CALL)
"""Names of commands that set an output, or the brake of an axis."""
_BRAKE: Final = re.compile(r"BRAKE\s+(\w+)\s+([01])", re.IGNORECASE)
_BRAKE_CALL: Final = re.compile(r"DriveBrakeO(n|ff)\(\s*(\w+)\s*\)", re.IGNORECASE)
_ARRAY: Final = re.compile(r"\$DO(?:\[(\d+)\]\.|(\d+)\.)(\w+)\s*=\s*(\S+)", re.IGNORECASE)
_CALL: Final = re.compile(
    r"DigitalOutputSet\(\s*(\w+)\s*,\s*(\d+)\s*,\s*(\S+?)\s*\)", re.IGNORECASE
)


def output_of(text: str) -> tuple[str, dict[str, str]] | None:
    """Return the output that a command sets, and its words; None where it sets none."""
    match = _ARRAY.fullmatch(text.strip())
    if match:
        number = match[1] if match[1] is not None else match[2]
        return SETS_ARRAY, {"NUMBER": number, "AXIS": match[3].upper(), "VALUE": match[4]}
    called = _CALL.fullmatch(text.strip())
    if called:
        return SETS_CALL, {"NUMBER": called[2], "AXIS": called[1].upper(), "VALUE": called[3]}
    brake = _BRAKE.fullmatch(text.strip())
    if brake:
        return SETS_BRAKE, {"AXIS": brake[1].upper(), "VALUE": brake[2]}
    braked = _BRAKE_CALL.fullmatch(text.strip())
    if braked:
        value = "1" if braked[1].upper() == "N" else "0"
        return SETS_BRAKE_BY_CALL, {"AXIS": braked[2].upper(), "VALUE": value}
    return None
