"""Lines side by side, for tests."""

from __future__ import annotations

import numpy as np

from registration.inspection import ExpectedLines


def straight_lines(count: int = 3, length_mm: float = 6.0) -> ExpectedLines:
    """Fresh lines along x, 1 mm apart and 0.4 mm wide."""
    number = np.arange(count)
    start = np.column_stack([np.zeros(count), number, np.full(count, 0.2)]).astype(np.float64)
    return ExpectedLines(
        start,
        start + (length_mm, 0.0, 0.0),
        np.full(count, 0.4),
        number,
        number,
        np.ones(count, dtype=np.bool_),
    )
