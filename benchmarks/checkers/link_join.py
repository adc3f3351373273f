"""Check that a file's strokes start, end and extrude where the file says.

A stroke is a move across; pauses, retreats and changes of syringe add moves of the plunger alone
and straight up and down, which are left out. Judged from where the motors went, in steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS_PER_MM = np.array([80.0, 80.0, 400.0, 6400.0])


@dataclass(frozen=True)
class Strokes:
    """Moves across, in order.

    Attributes
    ----------
    rows : (n, 7) int64, steps
        Beginning and end in x, y, z, and the plunger's travel between.
    """

    rows: NDArray[np.int64]

    @staticmethod
    def of(ends: NDArray[np.int64]) -> Strokes:
        """From where each move ends, (n, 4), the first beginning where the needle was put."""
        begins = np.vstack([ends[:1], ends[:-1]])
        return Strokes(_across(begins, ends))

    @staticmethod
    def made(motion: Any) -> Strokes:
        """What the simulated printer's motors did."""
        begins = np.column_stack([motion.start, motion.plunger_start]) * STEPS_PER_MM
        ends = np.column_stack([motion.end, motion.plunger_end]) * STEPS_PER_MM
        return Strokes(_across(np.round(begins), np.round(ends)))


def _across(begins: NDArray[Any], ends: NDArray[Any]) -> NDArray[np.int64]:
    rows = np.column_stack([begins[:, :3], ends[:, :3], ends[:, 3] - begins[:, 3]])
    return rows[np.any(begins[:, :2] != ends[:, :2], axis=1)].astype(np.int64)


def astray(expected: Strokes, motion: Any, unfinished: int = 0) -> int:
    """How many strokes aren't there, in order, as they should be; and how many are too many.

    Parameters
    ----------
    expected : Strokes
    motion : ExecutedMotion
    unfinished : int
        Lines that the print didn't come to.
    """
    made = [tuple(one) for one in Strokes.made(motion).rows.tolist()]
    wanted = [tuple(one) for one in expected.rows.tolist()]
    at = found = 0
    for one in wanted:
        if one in made[at : at + 4]:
            at, found = made.index(one, at) + 1, found + 1
    return max(len(wanted) - unfinished, len(made)) - found
