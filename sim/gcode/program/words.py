"""Parse the words of one G-code line as a firmware does."""

from __future__ import annotations

from typing import Final

import numpy as np

from kernels import jit
from sim.gcode.motion.state import Record

WORDS: Final = np.dtype(
    [
        ("letter", "i8"),  # of the command: G, M or T; 0 where there is none
        ("number", "i8"),  # after it; -1 where there is none
        ("begin", "i8"),  # index of the command's letter, after line number and blanks
        ("numbered", "i8"),  # the line number N; -1 without one
        ("seen", "i8"),  # bit 0 for A … bit 25 for Z: the letter stands in the line
        ("valued", "i8"),  # and a number follows it
        ("value", "f8", (26,)),
    ],
    align=True,
)
"""One line, taken apart."""

_POWERS = tuple(10.0**n for n in range(19))
_MOST_DIGITS = 17

_A, _Z = ord("A"), ord("Z")
_BLANK, _PLUS, _MINUS, _POINT = ord(" "), ord("+"), ord("-"), ord(".")
_ZERO, _NINE, _STAR = ord("0"), ord("9"), ord("*")
_G, _M, _N, _T = ord("G"), ord("M"), ord("N"), ord("T")
_TEXT_CODES = (23, 28, 30, 117, 118, 928)
_CODE_MASK = 0xFFFF
_REST = (_PLUS, _MINUS, _POINT)


@jit
def is_digit(char: int) -> bool:
    """Whether a byte is a decimal digit."""
    return _ZERO <= char <= _NINE


@jit
def number_at(text: bytes, at: int, end: int) -> tuple[float, int]:
    """Decimal number that begins at ``at``, and the index after it.

    No exponent: in G-code an E begins the next word. The index equals ``at`` where no number
    stands. Exact to the last bit up to 15 digits; digits beyond 17 are dropped.
    """
    i = at
    negative = False
    if i < end and (text[i] == _MINUS or text[i] == _PLUS):
        negative = text[i] == _MINUS
        i += 1
    mantissa = 0
    digits = 0
    decimals = 0
    whole = 0
    while i < end and is_digit(text[i]):
        if digits < _MOST_DIGITS:
            mantissa = mantissa * 10 + (text[i] - _ZERO)
            digits += 1 if mantissa > 0 else 0
        else:
            decimals -= 1
        whole += 1
        i += 1
    if i < end and text[i] == _POINT:
        i += 1
        while i < end and is_digit(text[i]):
            if digits < _MOST_DIGITS and decimals < 18:
                mantissa = mantissa * 10 + (text[i] - _ZERO)
                digits += 1 if mantissa > 0 else 0
                decimals += 1
            whole += 1
            i += 1
    if whole == 0:
        return 0.0, at
    value = float(mantissa)
    if decimals > 0:
        value /= _POWERS[decimals]
    elif decimals < 0:
        value *= _POWERS[min(-decimals, 18)]
    return (-value if negative else value), i


@jit
def _skip_blanks(text: bytes, at: int, end: int) -> int:
    while at < end and text[at] == _BLANK:
        at += 1
    return at


@jit
def split_words(text: bytes, start: int, end: int, words: Record) -> None:
    """Take ``text[start:end]`` apart: a line without comment and line end.

    The rules are those of Marlin's parser (``gcode/parser.cpp``, 2.1, built without subcodes,
    quoted strings and lower case): capitals only, the last of equal letters counts, a checksum is
    cut off, blanks may stand between a letter and its number, and whatever is neither letter nor
    number is skipped. A code is kept in 16 bits. Who must not be read so leniently asks
    `sim.gcode.reading` first.

    Parameters
    ----------
    text : bytes
    start, end : int
        The line.
    words : record of `WORDS`
        Written.
    """
    words.letter = 0
    words.number = -1
    words.numbered = -1
    words.seen = 0
    words.valued = 0
    at = _skip_blanks(text, start, end)
    if at + 1 < end and text[at] == _N and (is_digit(text[at + 1]) or text[at + 1] == _MINUS):
        value, _ = number_at(text, at + 1, end)
        words.numbered = int(value)
        at += 2
        while at < end and is_digit(text[at]):
            at += 1
        at = _skip_blanks(text, at, end)
    words.begin = at
    if at >= end:
        return
    letter = text[at]
    at += 1
    stop = at
    while stop < end and text[stop] != _STAR:
        stop += 1
    at = _skip_blanks(text, at, stop)
    if letter not in (_G, _M, _T) or at >= stop or not is_digit(text[at]):
        return
    words.letter = letter
    number = 0
    while at < stop and is_digit(text[at]):
        number = (number * 10 + (text[at] - _ZERO)) & _CODE_MASK
        at += 1
    words.number = number
    if letter == _M and number in _TEXT_CODES:
        return
    _split_parameters(text, at, stop, words)


@jit
def _split_parameters(text: bytes, at: int, stop: int, words: Record) -> None:
    while at < stop:
        letter = text[at]
        at += 1
        if _A <= letter <= _Z:
            at = _skip_blanks(text, at, stop)
            value, after = number_at(text, at, stop)
            bit = 1 << (letter - _A)
            words.seen |= bit
            words.valued &= ~bit
            if after > at:
                words.valued |= bit
                words.value[letter - _A] = value
                at = after
        while at < stop and (is_digit(text[at]) or text[at] in _REST):
            at += 1
