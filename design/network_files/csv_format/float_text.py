"""Write floats as their shortest decimal text, as Python's ``repr`` does, within kernels.

The digits are those of Giulietti, "The Schubfach way to render doubles" (2020): of the decimals
that read back to the same bits one of fewest digits, and of these the nearest. With 128 bits of a
power of ten, products rounded to odd compare like exact ones.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kernels import scalar_jit

LONGEST = 24
"""Characters of a float at most, as of -2.2250738585072014e-308."""

_LEAST, _MOST = -292, 324
"""Exponents of the powers of ten that all doubles need."""

_HALF = np.uint64(0xFFFFFFFF)
_HALF_BITS, _FRACTION_BITS = np.uint64(32), np.uint64(52)
_HIDDEN = np.uint64(1 << 52)
_FRACTION, _EXPONENT = np.uint64((1 << 52) - 1), np.uint64(0x7FF)
_ZERO, _ONE, _TWO, _FOUR, _TEN, _FORTY = (np.uint64(n) for n in (0, 1, 2, 4, 10, 40))
_SIGN = np.uint64(63)
_BIAS = 1075
_DIGIT_0, _DOT, _MINUS, _PLUS, _E = (np.uint8(ord(one)) for one in "0.-+e")


@cache
def powers_of_ten() -> NDArray[np.uint64]:
    """High and low 64 bits of the powers of ten, (n, 2), each scaled to 128 bits, rounded up."""
    found = np.empty((_MOST - _LEAST + 1, 2), np.uint64)
    for n, power in enumerate(range(_LEAST, _MOST + 1)):
        over, under = 10 ** max(power, 0), 10 ** max(-power, 0)
        shift = 127 - (over.bit_length() - 1 if power >= 0 else -under.bit_length())
        scaled = -(-(over << max(shift, 0)) // (under << max(-shift, 0)))
        found[n] = scaled >> 64, scaled & ((1 << 64) - 1)
    return found


@scalar_jit
def _high_product(a: Any, b: Any) -> Any:
    """High 64 bits of the product of two integers of 64 bits."""
    a0, a1, b0, b1 = a & _HALF, a >> _HALF_BITS, b & _HALF, b >> _HALF_BITS
    low, one, two = a0 * b0, a0 * b1, a1 * b0
    middle = (low >> _HALF_BITS) + (one & _HALF) + (two & _HALF)
    return a1 * b1 + (one >> _HALF_BITS) + (two >> _HALF_BITS) + (middle >> _HALF_BITS)


@scalar_jit
def _round_to_odd(high: Any, low: Any, factor: Any) -> Any:
    """Integer part of a factor times a power of ten over 2^128, odd where something is left."""
    below = _high_product(low, factor)
    middle = high * factor
    total = middle + below
    top = _high_product(high, factor)
    if total < middle:
        top += _ONE
    if total > _ONE:
        top |= _ONE
    return top


@scalar_jit
def _shortest(fraction: Any, exponent: int, powers: Any) -> tuple[Any, int]:
    """Decimal digits, and the power of ten that they count, of a positive double's bits."""
    if exponent > 0:
        c, q = _HIDDEN | fraction, exponent - _BIAS
    else:
        c, q = fraction, 1 - _BIAS
    odd = c & _ONE
    middle = c * _FOUR
    above = middle + _TWO
    # 1262611 / 2^22 is the logarithm of 2, 524031 / 2^22 that of 4/3, 1741647 / 2^19 is log2(10).
    if fraction == _ZERO and exponent > 1:
        # A power of two: the next double below is half as far away.
        below, k = middle - _ONE, (q * 1262611 - 524031) >> 22
    else:
        below, k = middle - _TWO, (q * 1262611) >> 22
    shift = np.uint64(q + ((-k * 1741647) >> 19) + 1)
    high, low = powers[-k - _LEAST, 0], powers[-k - _LEAST, 1]
    lower = _round_to_odd(high, low, below << shift) + odd
    value = _round_to_odd(high, low, middle << shift)
    upper = _round_to_odd(high, low, above << shift) - odd
    s = value // _FOUR
    if s >= _TEN:
        tens = s // _TEN
        under, over = lower <= _FORTY * tens, _FORTY * tens + _FORTY <= upper
        if under != over:
            return (tens + _ONE if over else tens), k + 1
    under, over = lower <= _FOUR * s, _FOUR * s + _FOUR <= upper
    if under != over:
        return (s + _ONE if over else s), k
    half = _FOUR * s + _TWO
    up = value > half or (value == half and (s & _ONE) == _ONE)
    return (s + _ONE if up else s), k


@scalar_jit
def put_text(out: Any, at: int, text: Any, size: int) -> int:
    """Write ``text[:size]`` (bytes) at ``out[at]``; return where it ends."""
    for n in range(size):
        out[at + n] = text[n]
    return at + size


@scalar_jit
def put_natural(out: Any, at: int, number: Any) -> int:
    """Write a whole number of at least 0 at ``out[at]``; return where it ends."""
    left = np.uint64(number)
    size = 1
    while left >= _TEN:
        left //= _TEN
        size += 1
    left = np.uint64(number)
    for n in range(at + size - 1, at - 1, -1):
        rest = left // _TEN
        out[n] = _DIGIT_0 + np.uint8(left - rest * _TEN)
        left = rest
    return at + size


@scalar_jit
def put_float(out: Any, at: int, bits: Any, powers: Any) -> int:
    """Write the finite float of these bits (uint64) at ``out[at]``; return where it ends."""
    if bits >> _SIGN != _ZERO:
        out[at] = _MINUS
        at += 1
    fraction, exponent = bits & _FRACTION, int((bits >> _FRACTION_BITS) & _EXPONENT)
    if fraction == _ZERO and exponent == 0:
        out[at], out[at + 1], out[at + 2] = _DIGIT_0, _DOT, _DIGIT_0
        return at + 3
    digits, power = _shortest(fraction, exponent, powers)
    while digits % _TEN == _ZERO:
        digits //= _TEN
        power += 1
    end = put_natural(out, at, digits)
    size = end - at
    point = size + power
    if -4 < point <= 0:
        # 0.00ddd
        lead = 2 - point
        for n in range(size - 1, -1, -1):
            out[at + lead + n] = out[at + n]
        for n in range(lead):
            out[at + n] = _DIGIT_0
        out[at + 1] = _DOT
        return end + lead
    if size <= point <= 16:
        # ddd00.0
        for n in range(size, point):
            out[at + n] = _DIGIT_0
        out[at + point], out[at + point + 1] = _DOT, _DIGIT_0
        return at + point + 2
    plain = 0 < point <= 16
    whole = point if plain else 1
    if size > whole:
        for n in range(size - 1, whole - 1, -1):
            out[at + n + 1] = out[at + n]
        out[at + whole] = _DOT
        end += 1
    if plain:
        return end
    # d.dde-07
    out[end], out[end + 1] = _E, _PLUS if point > 0 else _MINUS
    place = abs(point - 1)
    end += 2
    if place < 10:
        out[end] = _DIGIT_0
        end += 1
    return put_natural(out, end, place)
