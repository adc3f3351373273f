"""Floats as text, within kernels: as Python's repr."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from design.network_files.csv_format.float_text import LONGEST, powers_of_ten, put_float
from tests.slower import examples

AT_LIMITS = [
    *(0.0, -0.0, 5e-324, 2.2250738585072014e-308, -1.7976931348623157e308),
    *(1e15, 9999999999999998.0, 1e16, 12345678901234567.0, 1e-4, 9.999e-5, 1e22, 1e23),
    *(0.1, 100.0, -120.5, 1.5e-7, 2.0**53 + 2.0),
]


def _text(value: float) -> str:
    out = np.zeros(2 * LONGEST, np.uint8)
    end = put_float(out, 0, np.float64(value).view(np.uint64), powers_of_ten())
    assert end <= LONGEST
    return bytes(out[:end]).decode()


def test_text_at_the_limits_of_its_forms_is_that_of_repr() -> None:
    powers_of_two = 2.0 ** np.arange(-1074, 1024)
    around = [np.nextafter(powers_of_two, to) for to in (0.0, np.inf)]
    powers = [powers_of_two, *around, np.array([float(f"1e{n}") for n in range(-323, 309)])]
    for value in [*AT_LIMITS, *np.concatenate(powers).tolist()]:
        if np.isfinite(value):
            assert _text(value) == repr(value)


def test_text_of_random_bits_is_that_of_repr() -> None:
    bits = np.random.default_rng(5).integers(0, 1 << 64, 20_000, dtype=np.uint64)
    for value in bits.view(np.float64).tolist():
        if np.isfinite(value):
            assert _text(value) == repr(value)


@settings(max_examples=examples(300), deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False))
def test_text_of_any_float_is_that_of_repr(value: float) -> None:
    assert _text(value) == repr(value)
