"""What the simulated printer really did, as it would be seen by watching its motors."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ExecutedMotion:
    """Blocks in the order in which the planner ran them.

    Positions are those of the step counters (whole steps), so quantisation is in them.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Needle tip in the printer's frame.
    plunger_start, plunger_end : (n,) float64, mm
        Physical plunger travel since power-up (G92 doesn't move it).
    time_start, time_end : (n,) float64, s
        On the printer's own clock.
    line : (n,) int64
        Zero-based number of the job's command line that made the block; -1 when unknown, or a
        host's own. Of a simulated printer that doesn't know the job (`sim.marlin`) the number of
        the line that came, which counts a host's own lines; `sim.valve_blocks` finds the job's.
    """

    start: FloatArray
    end: FloatArray
    plunger_start: FloatArray
    plunger_end: FloatArray
    time_start: FloatArray
    time_end: FloatArray
    line: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.line)

    def save(self, path: Path) -> None:
        """Write as ``.npz`` by way of a temporary file."""
        draft = path.with_name(f".{path.stem}.{os.getpid()}.part.npz")
        try:
            np.savez(draft, **{field.name: getattr(self, field.name) for field in fields(self)})
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)

    @staticmethod
    def load(path: Path) -> ExecutedMotion:
        """Read what `save` wrote."""
        with np.load(path) as data:
            return ExecutedMotion(**{name: data[name] for name in data.files})
