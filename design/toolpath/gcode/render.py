"""Render a table of integer G-code words as text.

A value is counted in its last digit (``12.345`` with three decimals is 12345), so that text is
exact and nothing depends on how floats are printed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles.families.dialect import WORDS
from kernels import jit
from kernels.arrays import IntArray

Bytes = NDArray[np.uint8]

CHUNK: Final = 65_536
#: Longest text of a row: six words of a blank, a letter, sign, 19 digits and point; G and end.
ROW_BYTES: Final = 160


@dataclass(frozen=True)
class Table:
    """Commands ``G<code>`` with words.

    Attributes
    ----------
    code : (n,) int64
    value : (n, 6) int64
        X, Y, Z, E, F and P, each in its last digit.
    given : (n, 6) bool
        Whether the word is written.
    source, move : (n,) int64
        As in `Gcode`.
    """

    code: IntArray
    value: IntArray
    given: NDArray[np.bool_]
    source: IntArray
    move: IntArray

    def where(self, rows: IntArray | NDArray[np.bool_]) -> Table:
        """Return the rows of a mask or of row numbers."""
        return Table(
            self.code[rows], self.value[rows], self.given[rows], self.source[rows], self.move[rows]
        )


@jit
def _number(text: Bytes, at: int, value: int, decimals: int) -> int:
    """Write value / 10^decimals without trailing zeros; returns the place after it."""
    if value < 0:
        text[at] = 45
        at += 1
        value = -value
    while decimals > 0 and value % 10 == 0:
        value //= 10
        decimals -= 1
    digits, rest = 1, value // 10
    while rest > 0:
        rest //= 10
        digits += 1
    digits = max(digits, decimals + 1)
    length = digits + (1 if decimals > 0 else 0)
    for k in range(length):
        place = at + length - 1 - k
        if decimals > 0 and k == decimals:
            text[place] = 46
        else:
            text[place] = 48 + value % 10
            value //= 10
    return at + length


@jit
def _render(
    code: IntArray,
    value: IntArray,
    given: NDArray[np.bool_],
    decimals: IntArray,
    words: Bytes,
    text: Bytes,
) -> IntArray:
    """Write all rows; returns the end of each."""
    ends, at = np.empty(len(code), np.int64), 0
    for row in range(len(code)):
        text[at] = 71
        at = _number(text, at + 1, code[row], 0)
        for word in range(len(words)):
            if given[row, word]:
                text[at], text[at + 1] = 32, words[word]
                at = _number(text, at + 2, value[row, word], decimals[word])
        text[at] = 10
        at += 1
        ends[row] = at
    return ends


def render(
    table: Table, decimals: tuple[int, int, int, int, int, int], letters: bytes = WORDS
) -> tuple[bytes, int]:
    """Text of the commands and its longest line in bytes, the line end not counted."""
    words = np.frombuffer(letters, dtype=np.uint8)
    text = np.empty(CHUNK * ROW_BYTES, dtype=np.uint8)
    parts, longest = [], 0
    for low in range(0, len(table.code), CHUNK):
        part = table.where(np.arange(low, min(low + CHUNK, len(table.code))))
        ends = _render(part.code, part.value, part.given, np.array(decimals), words, text)
        parts.append(text[: ends[-1]].tobytes())
        longest = max(longest, int(np.diff(ends, prepend=0).max()) - 1)
    return b"".join(parts), longest
