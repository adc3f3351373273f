"""Type aliases of NumPy float, int64 and bool arrays, for signatures; rows cut into parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def split_rows(count: IntArray) -> tuple[IntArray, IntArray]:
    """Return each part's row and its number in that row, where row k is cut into count[k]."""
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
