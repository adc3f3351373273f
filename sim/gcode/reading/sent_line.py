"""Parse G-code lines in the form sent to the printer, already rendered by `read_line`."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

from firmware_profiles.families.common_words import TEXT_CODES
from sim.gcode.reading.line import BLANK, GcodeLine
from sim.gcode.reading.plain import PLAIN_MOVE, plain_move

_CODE: Final = re.compile(rb"[GMT]\d+")
_NUMBER: Final = re.compile(rb"-?\d+(?:\.\d+)?")
MOTION_LINES: Final = (b"G0", b"G1", b"G2", b"G3")


def read_sent(text: bytes) -> GcodeLine:
    """Read a line as it is sent; `BLANK` for an empty one.

    Parameters
    ----------
    text : bytes
        The ``text`` of a `GcodeLine`, or one of our own commands, written in the same way.
    """
    plain = PLAIN_MOVE.fullmatch(text)
    return plain_move(plain) if plain is not None else _read(text)


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
    return float(word) if _NUMBER.fullmatch(word) else None


@lru_cache(maxsize=4096)
def _read(text: bytes) -> GcodeLine:
    first, *rest = text.split(b" ")
    if not first:
        return BLANK
    code = first.decode("ascii")
    if not _CODE.fullmatch(first):
        pairs = (word.decode("ascii").partition("=") for word in rest)
        return GcodeLine(code, {}, text, {key: value for key, _, value in pairs})
    if code in TEXT_CODES:
        return GcodeLine(code, {}, text)
    words = {
        word[:1].decode("ascii"): float(word[1:]) if _NUMBER.fullmatch(word[1:]) else None
        for word in rest
    }
    return GcodeLine(code, words, text)
