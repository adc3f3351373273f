"""Parameter letters that each G-code accepts, by firmware family.

A code that isn't in a family's table takes any well-formed word: whether it may be sent at all is
decided elsewhere (`sim.gcode.reading.line`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final, NamedTuple

from firmware_profiles.families import find_family, meanings
from firmware_profiles.families.grammar import TEXT, Meaning
from sim.gcode.reading.line import GcodeLine, refusal

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


# Parse the words (letter and number) of a G-code command.

MOST_DIGITS: Final = 15
LARGEST: Final = 1e6
"""Of a number; a firmware's 32-bit float keeps the last micrometre up to 8 mm only, and its
integers end at 2 147 483 647."""
_WORD: Final = re.compile(
    rb"([A-Za-z])[ \t]*(?:([+-]?)(\d+\.?\d*|\.\d+)|(\"[^\"]*\"))?(?=[ \tA-Za-z]|$)[ \t]*"
)
_EXPONENT: Final = re.compile(rb"[\d.][eE][+-]?\d")
Word = tuple[str, float | None, bytes]
"""Capital letter, number, and the word as it is sent."""


def words_of(rest: bytes, text: bytes, family: str) -> Iterator[Word]:
    """Read what stands behind a code, word by word.

    Parameters
    ----------
    rest : bytes
        Behind the code's number.
    text : bytes
        The whole line, for messages.
    family : str
        The profile's ``firmware``.

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
                raise refusal("bad_number", text, f"{letter.decode()} has a text in quotes, which "
                              f"{family} doesn't know here; give a number")  # fmt: skip
            yield letter.decode(), None, letter + match[4]
        elif match[3] is None:
            yield letter.decode(), None, letter
        else:
            yield letter.decode(), *_number(letter, match[2], match[3], text)
        at = match.end()


def _number(letter: bytes, sign: bytes, digits: bytes, text: bytes) -> tuple[float, bytes]:
    value = float(sign + digits)
    if len(digits) - digits.count(b".") > MOST_DIGITS or abs(value) > LARGEST:
        raise refusal(
            "huge_number", text, f"{(letter + sign + digits[:24]).decode()} has more than "
            f"{MOST_DIGITS} digits or is beyond ±{LARGEST:.0f}, and firmwares would read another "
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
            "bad_number", text, f"{match[0].decode()!r} is a power of ten to some firmwares and an "
            "E word to others; write the number out, and a blank before a word of E"
        )  # fmt: skip


def _not_a_word(rest: bytes, text: bytes) -> Exception:
    shown = rest.split()[0].decode("ascii", "backslashreplace")
    if rest[:1] in b"{":
        return refusal("bad_number", text, "expressions in braces are worked out by the board "
                       "alone, and nothing here could check them; write the number")  # fmt: skip
    return refusal(
        "bad_number", text, f"{shown!r} isn't a letter with a decimal number (X-1.25); correct it"
    )


# Refuse G-code lines that firmwares interpret differently, or with meaningless values.

Words = Mapping[str, float | None]
_HEAD_CODES: Final = ("M104", "M109", "M218", "M221")


def check_meaning(code: str, words: Words, family: str, text: bytes) -> None:
    """Refuse a line that can't be meant, or is read in more than one way.

    Raises
    ------
    LineError
        With what is read differently, and what to write instead.
    """
    reason = (
        _of_motion(words) if code in MOTION else _OTHERS.get(code, _nothing)(words)
    ) or _of_numbers(code, words, family)
    if reason:
        raise refusal("ambiguous", text, reason)


def _nothing(words: Words) -> str:
    return ""


def _of_motion(words: Words) -> str:
    feed = words.get("F")
    if feed is not None and feed <= 0:
        return (
            f"F{feed:g} is left out by Marlin, an error to Klipper and the slowest feed to "
            "RepRapFirmware; write a feed above 0"
        )
    if "R" in words and ("I" in words or "J" in words):
        return "an arc has a centre (I J) or a radius (R), not both; firmwares choose differently"
    return ""


def _of_dwell(words: Words) -> str:
    if len(words) > 1:
        return "G4 has both P and S, of which firmwares take one or add them; keep one"
    if any(value is not None and value < 0 for value in words.values()):
        return "a dwell below 0 lasts 49 days on a Marlin; write a time of 0 or more"
    return ""


def _of_count(words: Words) -> str:
    if not words:
        return (
            "G92 alone sets every axis to 0 on some firmwares (the plunger too), and nothing on "
            "others; name them: G92 X0 Y0 Z0 E0"
        )
    return ""


_OTHERS: Final = {"G4": _of_dwell, "G92": _of_count}


def _of_numbers(code: str, words: Words, family: str) -> str:
    head = words.get("T") if code in _HEAD_CODES else None
    if head is not None and (head < 0 or head != int(head)):
        return f"T{head:g} isn't the number of a head; write 0, 1, ..."
    if code in find_family(family).grammar.whole:
        for letter, value in words.items():
            if value is not None and value != int(value):
                return f"{family} cuts {letter}{value:g} to a whole number; write one"
    return ""


# Parse named G-code commands: ``SET_PIN PIN=valve VALUE=1``.

_NAME: Final = re.compile(rb"([A-Za-z][A-Za-z_][A-Za-z0-9_]*)(?:[ \t]+|$)")
_PARAMETER: Final = re.compile(rb"([A-Za-z_][A-Za-z0-9_]*)=(\"[^\"]*\"|[^ \t\"'#=*]+)(?:[ \t]+|$)")
_PLAIN: Final = re.compile(rb"\"([^ \t\"'#=*]+)\"")
_NUMBER: Final = re.compile(rb"-?\d{1,6}(?:\.\d{1,9})?")
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
            raise refusal("repeated_word", text, f"{key} stands twice; keep one")
        if placing and key in _PLACES and not _NUMBER.fullmatch(word[2]):
            raise refusal(
                "bad_number", text, f"{key}={word[2].decode()!r} isn't a decimal number of at most "
                "6 and 9 digits; write one"
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
        words = {"NUMBER": called[2], "AXIS": called[1].upper(), "VALUE": called[3]}
        return SETS_CALL, words
    return None
