"""Print files for the link benchmark, generated from step counts: exact end known.

Nothing of the product is used: what the printer should do is known before it is asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

STEPS_PER_MM: Final = np.array([80.0, 80.0, 400.0, 6400.0])
"""Of the profile `generic_marlin`."""
START_MM: Final = (50.0, 50.0, 10.0)
_SIDE_STEPS: Final = 280  # 3.5 mm: well above the firmware's least steps
_ROW_STEPS: Final = 20
_DOSE_STEPS: Final = 22
_HEADER: Final = (b"M302 P1", b"G90", b"M82", b"M85 S600", b"G92 X50 Y50 Z10 E0")


@dataclass(frozen=True)
class PrintFile:
    """A file's commands, and where each move ends, (n, 4), steps, x to z and the plunger."""

    lines: list[bytes]
    ends: NDArray[np.int64]

    @property
    def data(self) -> bytes:
        """The file's bytes."""
        return b"\n".join(self.lines) + b"\n"

    def write(self, path: Path) -> Path:
        """Write it."""
        path.write_bytes(self.data)
        return path


def zigzag(moves: int, feed_mm_min: int = 1800) -> PrintFile:
    """Short moves to and fro, each with a dose; no two lines are alike."""
    k = np.arange(moves)
    start = np.round(np.array(START_MM) * STEPS_PER_MM[:3]).astype(np.int64)
    ends = np.empty((moves, 4), np.int64)
    ends[:, 0] = start[0] + (k % 2) * _SIDE_STEPS
    ends[:, 1] = start[1] + (k % 40) * _ROW_STEPS
    ends[:, 2] = start[2]
    ends[:, 3] = (k + 1) * _DOSE_STEPS
    mm = (ends / STEPS_PER_MM).tolist()
    text = [b"G1 X%.3f Y%.3f E%.5f F%d" % (x, y, e, feed_mm_min) for x, y, _, e in mm]
    return PrintFile([*_HEADER, *text], ends)
