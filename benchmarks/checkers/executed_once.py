"""Check from the step counters of the simulated printer that each move ran exactly once."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


def executed_ends(record: Path, steps_per_mm: NDArray[np.float64]) -> tuple[Ints, Ints]:
    """Return begins and ends of the blocks that ran, (n, 4), steps."""
    with np.load(record) as data:
        begin = np.column_stack([data["start"], data["plunger_start"]])
        end = np.column_stack([data["end"], data["plunger_end"]])
    return (
        np.round(begin * steps_per_mm).astype(np.int64),
        np.round(end * steps_per_mm).astype(np.int64),
    )


def lost_and_doubled(expected: Ints, begin: Ints, end: Ints) -> tuple[int, int]:
    """Return how many expected moves never ran, and how many ran once more.

    A move of the file goes along X or Y and doses; what the host adds at a pause goes straight up
    and down, or moves the plunger alone.

    Parameters
    ----------
    expected : (m, 4) int64, steps
        Ends of the file's moves, no two of them alike.
    begin, end : (n, 4) int64, steps
        Of the blocks that ran.
    """
    writes = (begin[:, :2] != end[:, :2]).any(axis=1)
    ran = Counter(map(tuple, end[writes].tolist()))
    counts = [ran.get(tuple(row), 0) for row in expected.tolist()]
    return sum(n == 0 for n in counts), sum(max(n - 1, 0) for n in counts)


def off_the_file(expected: Ints, begin: Ints, end: Ints) -> int:
    """Return how many blocks dosed while they moved to a place that isn't in the file."""
    writes = (begin[:, :2] != end[:, :2]).any(axis=1) & (end[:, 3] > begin[:, 3])
    known = set(map(tuple, expected.tolist()))
    return sum(tuple(row) not in known for row in end[writes].tolist())
