"""Compiler flags of the kernels."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import numpy as np
import pytest

from kernels import jit


@jit
def _ratio(a: float, b: float) -> float:
    return a / b


def test_nan_and_infinity_keep_their_meaning() -> None:
    assert np.isinf(_ratio(1.0, 0.0))
    assert np.isnan(_ratio(0.0, 0.0))
    assert np.isnan(_ratio(np.nan, 1.0))


@jit
def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.dot(a, b)


def test_matrix_products_work() -> None:
    assert (_product(2 * np.eye(2), np.ones((2, 2))) == 2).all()


# Reuse of freed memory for large arrays.

KEPT_THEN_GIVEN_BACK = """
import numpy as np
from kernels import keep_freed_memory
from pathlib import Path

def held():
    return 4096 * int(Path("/proc/self/statm").read_text().split()[1])

before = held()
with keep_freed_memory():
    for _ in range(3):
        large = np.ones(12_000_000)
        del large
    kept = held() - before
after = held() - before
assert kept > 90e6, kept
assert after < 10e6, after
"""


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library has no mallopt"
)
def test_freed_memory_is_kept_within_and_given_back_behind() -> None:
    subprocess.run([sys.executable, "-c", KEPT_THEN_GIVEN_BACK], check=True)
