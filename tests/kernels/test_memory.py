"""Reuse of freed memory for large arrays."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

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
