"""Decimal text of rows: as Python formats and parses it, odd numbers included."""

from __future__ import annotations

import numpy as np
import pytest

from design.geometry.decimal_text import read_rows, rows_text

MARKS = (b'<v x="', b'" y="', b'" z="', b'"/>\n')


def _by_python(values: np.ndarray, form: bytes) -> bytes:
    return form.join(MARKS) * len(values) % tuple(values.ravel().tolist())


def _numbers() -> np.ndarray:
    random = np.random.default_rng(5)
    found = random.uniform(-1, 1, (5000, 3)) * 10.0 ** random.uniform(-7, 10, (5000, 1))
    found[:3] = [[0.0, -0.0, 1.0], [0.5, 1e-30, 16777216.0], [1e-4, 99999.9921875, 2.0**31]]
    return found.astype(np.float32).astype(np.float64)


def test_float32_is_written_as_python_writes_it() -> None:
    values = _numbers()
    assert rows_text(values, MARKS) == _by_python(values, b"%.17g")
    np.testing.assert_array_equal(read_rows(rows_text(values, MARKS), MARKS), values)


def test_whole_numbers_are_written_as_python_writes_them() -> None:
    values = np.random.default_rng(5).integers(-3, 2**31 - 1, (5000, 3), dtype=np.int32)
    assert rows_text(values, MARKS) == _by_python(values, b"%d")
    assert rows_text(values[:0], MARKS) == b""


@pytest.mark.parametrize("form", [b"%.17g", b"%.6f", b"%.9g", b"%+.3e", b"%.15g", b"%.24f"])
def test_the_nearest_float64_is_read(form: bytes) -> None:
    values = _numbers() * (1.0 + 1e-9)
    words = [form % number for number in values.ravel().tolist()]
    expected = np.array([float(word) for word in words]).reshape(-1, 3)
    np.testing.assert_array_equal(read_rows(_by_python(values, form), MARKS), expected)


@pytest.mark.parametrize(
    "text",
    [
        b'<v x="1" y="2" z="3"/><v x="1" y="2"/>',
        b'<v x="1" y="" z="3"/>',
        b'<v x="1" y="1.2.3" z="3"/>',
        b'<v x="." y="1" z="3"/>',
        b'<v x="1" y="2" z="nan"/>',
        b'<v x="1" y="2" z="3"/>more',
    ],
)
def test_other_text_is_refused(text: bytes) -> None:
    assert read_rows(text, MARKS) is None
