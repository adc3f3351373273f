"""Read one G-code line by the rules of the printer's firmware family, or refuse it."""

from __future__ import annotations

import re
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import find_family
from sim.gcode.reading.ambiguity import check_meaning
from sim.gcode.reading.faults import refusal
from sim.gcode.reading.line import BLANK, GcodeLine
from sim.gcode.reading.named import named_line
from sim.gcode.reading.numbers import words_of
from sim.gcode.reading.plain import PLAIN_MOVE, plain_move
from sim.gcode.reading.strip import command_in
from sim.gcode.reading.text import second_command, text_line
from sim.gcode.reading.translators import Translate, translator_of
from sim.gcode.reading.words import AXES, MOTION, AcceptedLetters, accepted_letters

_CODE: Final = re.compile(rb"([GMTgmt])[ \t]*(\d+)(?![\d.])")
_SUBCODE: Final = re.compile(rb"[GMTgmt][ \t]*\d*\.")
_MOST_CODE: Final = 9999


def read_line(text: bytes, printer: Printer) -> GcodeLine:
    """Read one line of G-code.

    Parameters
    ----------
    text : bytes
        A line of a file, or what was typed; a line end, a comment, a line number with its
        checksum and lower case may be in it.
    printer : Printer
        Its ``firmware`` says how it is read.

    Returns
    -------
    GcodeLine
        False (`BLANK`) for a comment or an empty line. A code that the firmware doesn't know comes
        as it stands: `sim.gcode.reading.firmware_codes.is_known_line` judges it.

    Raises
    ------
    LineError
        When it can't be read, has a word that the code doesn't know, or means different things to
        firmwares of one family.
    """
    plain = PLAIN_MOVE.fullmatch(text)
    if plain is not None:
        return plain_move(plain)
    translate = translator_of(printer)
    if translate is not None:
        return _translated(text, printer, translate)
    return read_words(text, printer)


def _translated(text: bytes, printer: Printer, translate: Translate) -> GcodeLine:
    """Read a line in another language; what isn't G-code comes with its name."""
    written = translate(text.rstrip(b"\r\n"), printer)
    for named in written.named:
        return GcodeLine(named.name, {}, text.strip(), named.words)
    return read_words(written.gcode, printer)


def read_words(text: bytes, printer: Printer) -> GcodeLine:
    """Read a line of G-code; `read_line` without a plain move's short road, or another language."""
    family = printer.firmware
    command = command_in(text, family)
    if not command:
        return BLANK
    match = _CODE.match(command)
    if match is None:
        return _without_code(command, text, family)
    code = _code_of(match, text, family)
    rest = command[match.end() :]
    letters = accepted_letters(family, code) if code not in printer.extra_commands else None
    if letters is not None and letters.text:
        return text_line(code, rest, text, family)
    return _with_words(code, rest, text, family, letters)


def is_name(code: str) -> bool:
    """Whether a line's code is a name, not a letter with a number."""
    return bool(code) and not (code[0] in "GMT" and code[1:].isdigit())


def _code_of(match: re.Match[bytes], text: bytes, family: str) -> str:
    number = int(match[2]) if len(match[2]) <= 9 else _MOST_CODE + 1
    letter = match[1].decode()
    if number > _MOST_CODE:
        raise refusal(
            "bad_code", text, f"{letter}{match[2].decode()[:24]} is no code: numbers end at "
            f"{_MOST_CODE}, and Marlin counts from 0 again above 65535; correct it"
        )  # fmt: skip
    if letter.islower() and not find_family(family).grammar.lower_case:
        raise refusal(
            "bad_code", text, f"{family} reads capitals only; write {letter.upper()}{number}"
        )
    return f"{letter.upper()}{number}"


def _without_code(command: bytes, text: bytes, family: str) -> GcodeLine:
    if _SUBCODE.match(command):
        raise refusal(
            "bad_code", text, "a code with a point is another command to some builds of a "
            "firmware, and the one before the point to others; take it out"
        )  # fmt: skip
    named = named_line(command, text) if find_family(family).grammar.named else None
    if named is None:
        raise refusal(
            "no_command", text, "isn't a command: G, M or T with a number must come first; take it "
            "out, or write it behind a semicolon"
        )  # fmt: skip
    return named


def _with_words(
    code: str, rest: bytes, text: bytes, family: str, letters: AcceptedLetters | None
) -> GcodeLine:
    words: dict[str, float | None] = {}
    parts = [code.encode()]
    for letter, value, part in words_of(rest, text, family):
        if letters is not None:
            _check_word(letter, value, code, letters, text, family)
        elif letter in "GM" and value is not None:
            raise second_command(part.decode(), text)
        if letter in words:
            raise refusal(
                "repeated_word", text, f"{letter} stands twice, and firmwares differ in which one "
                "counts; keep one"
            )  # fmt: skip
        words[letter] = value
        parts.append(part)
    check_meaning(code, words, family, text)
    return GcodeLine(code, words, b" ".join(parts))


def _check_word(
    letter: str, value: float | None, code: str, letters: AcceptedLetters, text: bytes, family: str
) -> None:
    if letter not in letters.letters:
        if code in MOTION and letter in AXES:
            raise refusal(
                "unknown_axis", text, f"{letter} is an axis that the machine hasn't (profile: X, "
                f"Y, Z and the plunger's E), or a word that {code} doesn't know; take it out"
            )  # fmt: skip
        names = " ".join(sorted(letters.letters)) or "no words"
        raise refusal(
            "unknown_word", text, f"{letter} is a word that {code} of {family} doesn't know (it "
            f"takes {names}); take it out"
        )  # fmt: skip
    if value is None and letter not in letters.alone:
        raise refusal(
            "bad_number", text, f"{letter} has no number that can be read; write digits behind it "
            f"({letter}5.2)"
        )  # fmt: skip
