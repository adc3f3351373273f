"""Write and read rows of three decimal numbers between fixed pieces of text (compiled).

A design's 3MF file holds tens of millions of digits; formatted and parsed by Python they take
longer than the boolean that made the solid. Rows that the kernels don't take (numbers that aren't
of float32, exponents) are left to Python.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels import jit

Bytes = NDArray[np.uint8]
Marks = tuple[bytes, bytes, bytes, bytes]

_MINUS, _DOT, _ZERO = 45, 46, 48
_DIGITS: Final = 17
"""Significant digits by which every float64 is told from its neighbours."""

_LEAST, _MOST = 1e-4, 2.0**31
"""Sizes that ``%.17g`` writes without an exponent, and whose whole part is an int32."""

_BITS = 40
"""Binary places that hold each fraction of a float32 of at least `_LEAST`."""

_STEPS = 2.0**_BITS
_BELOW = (1 << _BITS) - 1
_HALF = 1 << (_BITS - 1)

_STRETCH = 4096
"""Rows written at a time."""

_ROOM = 26
"""Characters that a number takes at most."""

_MOST_PLACES = 22
"""Decimal places p for which 10^p is a float64."""

_SPLIT = 134217729.0
"""2^27 + 1: halves a float64's digits (Dekker 1971, 10.1007/BF01397083)."""

_DOUBT = 1e-6
"""Of half a step: nearer to the middle of two floats a sum of two floats doesn't decide."""


def rows_text(values: NDArray[np.float64] | NDArray[np.int32], marks: Marks) -> bytes:
    """Text of rows (n, 3): each number between two of the ``marks``, as ``%d`` or ``%.17g``."""
    kernel: Any = _write_float32 if values.dtype.kind == "f" else _write_whole
    form = b"%.17g" if kernel is _write_float32 else b"%d"
    odd = _are_odd(values) if kernel is _write_float32 else np.any(values < 0, axis=1)
    kept = np.ascontiguousarray(values, np.float64 if kernel is _write_float32 else np.int64)
    row, pieces = form.join(marks), _pieces(marks)
    out = np.empty(_STRETCH * (3 * _ROOM + sum(len(mark) for mark in marks)), dtype=np.uint8)
    parts: list[bytes] = []
    for begin, end in pairwise([*_stretches(odd), len(kept)]):
        if odd[begin]:
            parts.append(row % tuple(kept[begin].tolist()))
        else:
            parts.append(out[: kernel(kept[begin:end], *pieces, out)].tobytes())
    return b"".join(parts)


def _pieces(marks: Sequence[bytes]) -> tuple[Bytes, Bytes, Bytes, Bytes]:
    first, second, third, last = (np.array(list(mark), dtype=np.uint8) for mark in marks)
    return first, second, third, last


def _are_odd(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Rows (n,) with a number that isn't float32, or is written with an exponent or as -0."""
    size = np.abs(values)
    small = (size < _LEAST) & ((values != 0.0) | np.signbit(values))
    odd = (values != values.astype(np.float32)) | small | ~(size < _MOST)
    return np.asarray(odd.any(axis=1))


def _stretches(odd: NDArray[np.bool_]) -> list[int]:
    """Where stretches of rows begin: of one odd row, or of at most `_STRETCH` others."""
    at = np.flatnonzero(odd)
    begins = np.concatenate([np.arange(0, len(odd), _STRETCH), at, at + 1])
    starts: list[int] = np.unique(begins[begins < len(odd)]).tolist()
    return starts


def read_rows(text: bytes, marks: Marks) -> NDArray[np.float64] | None:
    """Numbers (n, 3) of a text as `rows_text` writes it, with any white space; else None.

    Each is the float64 nearest to its digits.
    """
    bare = [mark.strip() for mark in marks]
    pieces = _pieces(bare)
    odd = re.compile(rb"([-+.\deE]+)".join(re.escape(mark) for mark in bare) + rb"\s*")
    values = np.empty((text.count(bare[0]), 3))
    data = np.frombuffer(text, dtype=np.uint8)
    row, at = _read(data, *pieces, values, 0, 0)
    while row < len(values):
        match = odd.match(text, at)
        if match is None:
            return None
        try:
            values[row] = [float(number) for number in match.groups()]
        except ValueError:
            return None
        row, at = _read(data, *pieces, values, row + 1, match.end())
    return values if at == len(text) else None


@jit
def _put(piece: Bytes, out: Bytes, at: int) -> int:
    """Write a piece of text at a place; return the place after it."""
    for k in range(len(piece)):
        out[at + k] = piece[k]
    return at + len(piece)


@jit
def _put_whole(value: int, out: Bytes, at: int) -> int:
    """Write a number that isn't below 0; return the place after it."""
    count, left = 1, value // 10
    while left > 0:
        count += 1
        left //= 10
    for k in range(count):
        out[at + count - 1 - k] = _ZERO + value % 10
        value //= 10
    return at + count


@jit
def _write_whole(
    values: NDArray[np.int64], first: Bytes, second: Bytes, third: Bytes, last: Bytes, out: Bytes
) -> int:
    """Write rows of whole numbers; return how many characters that took."""
    at = 0
    for n in range(len(values)):
        at = _put_whole(values[n, 0], out, _put(first, out, at))
        at = _put_whole(values[n, 1], out, _put(second, out, at))
        at = _put(last, out, _put_whole(values[n, 2], out, _put(third, out, at)))
    return at


@jit
def _put_float32(value: float, out: Bytes, at: int) -> int:
    """Write a float32 as ``%.17g`` does; return the place after it.

    Its fraction is a whole number of 2^-40, from which each digit is taken exactly. All nines
    can't come up: 17 digits tell a float32 from the next whole number.
    """
    if value < 0.0:
        out[at] = _MINUS
        at += 1
        value = -value
    whole = int(value)
    fraction = int((value - whole) * _STEPS)
    begin = at
    at = _put_whole(whole, out, at)
    left = _DIGITS - (at - begin) if whole > 0 else _DIGITS
    if fraction == 0:
        return at
    out[at] = _DOT
    at += 1
    seen = whole > 0
    while left > 0 and fraction > 0:
        fraction *= 10
        digit = fraction >> _BITS
        fraction &= _BELOW
        seen = seen or digit > 0
        left -= seen
        out[at] = _ZERO + digit
        at += 1
    if fraction > _HALF or (fraction == _HALF and out[at - 1] % 2 == 1):
        k = at - 1
        while out[k] == _ZERO + 9:
            out[k] = _ZERO
            k -= 1
        out[k] += 1
    while out[at - 1] == _ZERO:
        at -= 1
    return at


@jit
def _write_float32(
    values: NDArray[np.float64], first: Bytes, second: Bytes, third: Bytes, last: Bytes, out: Bytes
) -> int:
    """Write rows of float32; return how many characters that took."""
    at = 0
    for n in range(len(values)):
        at = _put_float32(values[n, 0], out, _put(first, out, at))
        at = _put_float32(values[n, 1], out, _put(second, out, at))
        at = _put(last, out, _put_float32(values[n, 2], out, _put(third, out, at)))
    return at


@jit
def _after_space(text: Bytes, at: int) -> int:
    """The first place from ``at`` on that isn't white space."""
    while at < len(text) and (text[at] == 32 or 9 <= text[at] <= 13):
        at += 1
    return at


@jit
def _after_piece(text: Bytes, at: int, piece: Bytes) -> int:
    """The place after a piece of text that stands at ``at``; -1 where it doesn't."""
    if at < 0 or at + len(piece) > len(text):
        return -1
    for k in range(len(piece)):
        if text[at + k] != piece[k]:
            return -1
    return at + len(piece)


@jit
def _number(text: Bytes, at: int) -> tuple[float, int]:
    """The number that stands at ``at``, and the place after it; -1 where none can be read."""
    if at < 0:
        return 0.0, -1
    negative = at < len(text) and text[at] == _MINUS
    at += negative
    digits, count, places, after_dot = 0, 0, 0, False
    begin = at
    while at < len(text):
        c = int(text[at])
        if c == _DOT and not after_dot:
            after_dot = True
        elif _ZERO <= c <= _ZERO + 9:
            digits = 10 * digits + (c - _ZERO)
            count += digits > 0
            places += after_dot
        else:
            break
        at += 1
    if count > 18 or places > _MOST_PLACES or at - begin - after_dot == 0:
        return 0.0, -1
    value, sure = _over_ten(digits, places)
    return (-value if negative else value), (at if sure else -1)


@jit
def _over_ten(digits: int, places: int) -> tuple[float, bool]:
    """The float64 nearest to digits / 10^places; and whether that is sure.

    The quotient as a sum of two floats: the remainder of the first is exact by Dekker's product.
    """
    high = float(digits)
    low = float(digits - int(high))
    if places == 0 and low == 0.0:
        return high, True
    by = 1.0
    for _ in range(places):
        by *= 10.0
    first = high / by
    product, error = _product(first, by)
    second = (((high - product) - error) + low) / by
    total = first + second
    rest = abs(second - (total - first))
    half = 0.5 * np.spacing(total) if total > 0.0 else 1.0
    return total, abs(rest - half) > _DOUBT * half


@jit
def _product(a: float, b: float) -> tuple[float, float]:
    """A product, rounded, and its rounding error."""
    p = a * b
    c, d = _SPLIT * a, _SPLIT * b
    a1, b1 = c - (c - a), d - (d - b)
    a2, b2 = a - a1, b - b1
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


@jit
def _read(
    text: Bytes,
    first: Bytes,
    second: Bytes,
    third: Bytes,
    last: Bytes,
    values: NDArray[np.float64],
    row: int,
    at: int,
) -> tuple[int, int]:
    """Read rows from the place ``at``; the first that can't be read, and where it stands."""
    at = _after_space(text, at)
    for n in range(row, len(values)):
        values[n, 0], next_at = _number(text, _after_piece(text, at, first))
        values[n, 1], next_at = _number(text, _after_piece(text, next_at, second))
        values[n, 2], next_at = _number(text, _after_piece(text, next_at, third))
        next_at = _after_piece(text, next_at, last)
        if next_at < 0:
            return n, at
        at = _after_space(text, next_at)
    return len(values), at
