"""Read one G-code line by the rules of the printer's firmware family, or refuse it."""

from __future__ import annotations

import re
from binascii import crc_hqx
from collections.abc import Sequence
from functools import lru_cache, reduce
from operator import xor
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families import find_family
from firmware_profiles.families.grammar import TEXT_CODES
from gcode.errors import LineError
from gcode.reading.line import (
    AXES,
    BLANK,
    MOTION,
    AcceptedLetters,
    GcodeLine,
    Translate,
    accepted_letters,
    check_meaning,
    named_line,
    refusal,
    translator_of,
    words_of,
)

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
        as it stands: `gcode.reading.line.is_known_line` judges it.

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
    written = translate(text.rstrip(b"\r\n"), printer, 0)
    for _, error in written.refused:
        raise error
    for _, named in written.named:
        return named
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


# A comment begins at a semicolon; what stands in parentheses is one, too. Some builds of a firmware
# take parentheses for words (Marlin without PAREN_COMMENTS), and a semicolon in quotes for text:
# since the comment isn't sent, both then do the same, and where the two readings would leave
# different commands the line is refused.
_PARENTHESES: Final = re.compile(rb"\([^()]*\)")
_NUMBER: Final = re.compile(rb"[Nn]-?\d{1,10}(?![\d.])[ \t]*")
_CHECKSUM: Final = re.compile(rb"\*[ \t]*(\d+)[ \t]*")
_CRC_DIGITS: Final = 5
_LONGEST: Final = 2_000
"""Bytes of a command as it stands in a file, without the comment behind a semicolon: firmwares take
some 100 to 250, and what is sent is held against the profile's own limit (``max_line_bytes``)."""


def command_in(text: bytes, family: str) -> bytes:
    """Return the command in a line, empty where there is none.

    Raises
    ------
    LineError
        For a wrong checksum, comments that don't close, characters that can't be sent, or too many
        of them.
    """
    command = text.partition(b";")[0].strip(b" \t\r\n")
    if not command:
        return b""
    if len(command) > _LONGEST:
        raise refusal(
            "too_long", text, f"its command has {len(command)} bytes, at most {_LONGEST} are read "
            "(firmwares take some 100); take out what is too much"
        )  # fmt: skip
    command = _without_number(command, text, family)
    if b"(" in command or b")" in command:
        if not find_family(family).grammar.parentheses:
            raise refusal(
                "bad_comment", text, f"{family} has no comments in parentheses and would read them "
                "as part of the command; write the comment behind a semicolon"
            )  # fmt: skip
        command = _PARENTHESES.sub(b" ", command).strip(b" \t")
        if b"(" in command or b")" in command:
            raise refusal(
                "bad_comment", text, "a parenthesis isn't closed, or stands in another; firmwares "
                "differ in what they read then: write the comment behind a semicolon"
            )  # fmt: skip
    if command.count(b'"') % 2:
        raise refusal(
            "bad_comment", text, 'a quote isn\'t closed; write texts in "two quotes", without ;'
        )
    for char in command:
        if (char < 32 and char != 9) or char > 126 or char == 92:
            raise refusal(
                "not_text", text, f"byte {char} (0x{char:02x}) can't be sent in a command; remove "
                "it, or write it behind a semicolon"
            )  # fmt: skip
    return command


def _without_number(command: bytes, text: bytes, family: str) -> bytes:
    """Take off line number and checksum, if that is right."""
    body, star, _ = command.partition(b"*")
    if star:
        _check(body, command[len(body) :], text, family)
    if body[:1] not in b"Nn":
        return body.rstrip(b" \t")
    number = _NUMBER.match(body)
    if number is None:
        raise refusal(
            "bad_checksum", text, "N isn't followed by a line number (N12); write it so or take "
            "it out"
        )  # fmt: skip
    return body[number.end() :].rstrip(b" \t")


def _check(body: bytes, rest: bytes, text: bytes, family: str) -> None:
    match = _CHECKSUM.fullmatch(rest)
    if match is None:
        raise refusal(
            "bad_checksum", text, "an asterisk begins a checksum, and no number alone follows it; "
            "take it out"
        )  # fmt: skip
    checksum = int(match[1]) if len(match[1]) <= _CRC_DIGITS else -1
    crc = find_family(family).grammar.crc16 and len(match[1]) == _CRC_DIGITS
    right = crc_hqx(body, 0) if crc else reduce(xor, body, 0)
    if checksum != right:
        raise refusal(
            "bad_checksum", text, f"its checksum is {match[1].decode()}, and the line's is "
            f"{right}: the line was changed or damaged; export the file again"
        )  # fmt: skip


# RepRapFirmware (``StringParser.cpp``) takes several commands from one line. There a text ends with
# its closing quote, and what follows is carried out; only some codes take the rest of the line as
# it is (`Grammar.rest_codes`), and only without a quote. It works out a text in braces
# (`Grammar.expressions`), and carries out what follows it.
_QUOTED: Final = re.compile(rb'"[^"]*"')
_WHOLE: Final = re.compile(rb'"[^"]*"(?:"[^"]*")*')
_COMMAND: Final = re.compile(rb"[GMTgmt][ \t]*\d")


def text_line(code: str, rest: bytes, text: bytes, family: str) -> GcodeLine:
    """Read a code whose ``rest`` is a text; ``text`` is the whole line, for messages.

    Raises
    ------
    LineError
        For a text that renumbers lines, one that the firmware works out, and one behind or in
        which it finds a command.
    """
    argument = b" ".join(rest.split(b"\t")).strip(b" ")
    if b"M110" in argument.replace(b" ", b"").upper():
        raise refusal(
            "ambiguous", text, "a text with M110 in it renumbers the lines of a Marlin; write "
            "another text"
        )  # fmt: skip
    _no_expression(argument, text, family)
    _one_command(code, argument, text, family)
    return GcodeLine(code, {}, code.encode() + (b" " + argument if argument else b""))


def second_command(shown: str, text: bytes) -> LineError:
    """Error for a line with a second command in it."""
    return refusal(
        "ambiguous", text, f"{shown!r} is another command of the line to some firmwares and "
        "nothing to others; write each command on a line of its own"
    )  # fmt: skip


def _no_expression(argument: bytes, text: bytes, family: str) -> None:
    """Refuse braces, wherever they stand, where the firmware works out what is in them."""
    if find_family(family).grammar.expressions and (b"{" in argument or b"}" in argument):
        raise refusal(
            "ambiguous", text, f"{family} works out a text in braces, and what stands behind it is "
            "carried out as another command; write the text without braces"
        )  # fmt: skip


def _one_command(code: str, argument: bytes, text: bytes, family: str) -> None:
    """Refuse what stands behind a closed quote, or is a command in a text that isn't quoted."""
    rest_codes = find_family(family).grammar.rest_codes
    if rest_codes is None:
        return
    if code in rest_codes:
        if b'"' in argument and not _WHOLE.fullmatch(argument):
            raise refusal(
                "ambiguous", text, f"to {family} the text ends with its quote, and what stands "
                "beside it may be carried out; write the whole text in one pair of quotes"
            )  # fmt: skip
        return
    match = _COMMAND.search(_QUOTED.sub(b"", argument))
    if match is not None:
        raise second_command(match[0].decode(), text)


# Read here without the checks of other lines; `gcode.reading.read` would
# read each of them alike (a test compares the two).
_DECIMAL: Final = rb"(-?\d{1,6}(?:\.\d{1,9})?)"
_FEED: Final = rb"(?: F([1-9]\d{0,5}(?:\.\d{1,9})?))?"
PLAIN_MOVE: Final = re.compile(
    rb"(G[01])"
    + _FEED
    + b"".join(rb"(?: %c" % letter + _DECIMAL + b")?" for letter in b"XYZE")
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


_SENT_CODE: Final = re.compile(rb"[GMT]\d+")
_SENT_NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?")
MOTION_LINES: Final = (b"G0", b"G1", b"G2", b"G3")


def read_sent(text: bytes) -> GcodeLine:
    """Read a line as it is sent; `BLANK` for an empty one.

    Parameters
    ----------
    text : bytes
        The ``text`` of a `GcodeLine`, or one of our own commands, written in the same way.
    """
    plain = PLAIN_MOVE.fullmatch(text)
    return plain_move(plain) if plain is not None else _read_sent(text)


def code_of(text: bytes) -> bytes:
    """Code of a line as it is sent, without reading its words."""
    return text.partition(b" ")[0]


def is_motion(text: bytes) -> bool:
    """Whether a line as it is sent is a move or an arc."""
    return code_of(text) in MOTION_LINES


def plunger_word(text: bytes) -> float | None:
    """Number behind E of a move or a G92, as `read_sent` gives it, in a tenth of its time."""
    begin = text.find(b" E")
    if begin < 0 or not (is_motion(text) or text.startswith(b"G92 ")):
        return None
    word = text[begin + 2 :].partition(b" ")[0]
    return float(word) if _SENT_NUMBER.fullmatch(word) else None


@lru_cache(maxsize=4096)
def _read_sent(text: bytes) -> GcodeLine:
    first, *rest = text.split(b" ")
    if not first:
        return BLANK
    code = first.decode("ascii")
    if not _SENT_CODE.fullmatch(first):
        pairs = (word.decode("ascii").partition("=") for word in rest)
        return GcodeLine(code, {}, text, {key: value for key, _, value in pairs})
    if code in TEXT_CODES:
        return GcodeLine(code, {}, text)
    words = {
        word[:1].decode("ascii"): float(word[1:]) if _SENT_NUMBER.fullmatch(word[1:]) else None
        for word in rest
    }
    return GcodeLine(code, words, text)


# Only moves that write are changed: those that push the plunger on a way of the tip. What moves the
# plunger alone (drawing back, priming) keeps its length. The count of E goes on from where it was;
# a line that counts the plunger anew (G92 E) stays.
LEAST: Final = 0.3
MOST: Final = 3.0
"""Of the file's own doses."""
_ACROSS: Final = (b" X", b" Y", b" Z")


def with_flow(lines: Sequence[bytes], e_mm: float, factor: float) -> list[bytes]:
    """Return lines whose writing moves push ``factor`` times as far.

    Parameters
    ----------
    lines : sequence of bytes
        Of a job, from some place on; E absolute.
    e_mm : float, mm
        The plunger's count before the first.
    """
    was = now = e_mm
    scaled = list(lines)
    for index, line in enumerate(lines):
        to = plunger_word(line)
        if to is None:
            continue
        if not is_motion(line):  # G92
            was = now = to
            continue
        writes = to > was and any(axis in line for axis in _ACROSS)
        now += (to - was) * (factor if writes else 1.0)
        was = to
        scaled[index] = _with_e(line, now)
    return scaled


def plunger_count(lines: Sequence[bytes]) -> float:
    """Return the plunger's count after some lines of a job, mm; 0 where none tells it."""
    for line in reversed(lines):
        e_mm = plunger_word(line)
        if e_mm is not None:
            return e_mm
    return 0.0


def _with_e(line: bytes, e_mm: float) -> bytes:
    before, _, behind = line.partition(b" E")
    _, space, rest = behind.partition(b" ")
    return b"%b E%.5f%b%b" % (before, e_mm, space, rest)
