"""Parse the words (letter and number) of a G-code command."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from firmware_profiles.families import find_family
from sim.gcode.reading.faults import refusal

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
