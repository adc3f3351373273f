"""Read the binary event log that a simulated board writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

AXES = "XYZE"
KINDS = ("step", "reset", "power_off", "power_on", "mark", "stall", "heater", "enable")
RECORD = np.dtype(
    [
        ("cycle", "<u8"),
        ("ns", "<u8"),
        ("position", "<i4"),
        ("axis", "u1"),
        ("direction", "i1"),
        ("enabled", "u1"),
        ("kind", "u1"),
    ]
)


@dataclass(frozen=True)
class StepLog:
    """Events of a board in the order in which they happened.

    Attributes
    ----------
    records : (n,) structured array of RECORD
        Times in cycles of the processor and in ns of the host's monotonic clock.
    """

    records: NDArray[np.void]

    def of_kind(self, kind: str) -> NDArray[np.void]:
        """Return the records of one kind."""
        found: NDArray[np.void] = self.records[self.records["kind"] == KINDS.index(kind)]
        return found

    def steps(self, axis: str | None = None) -> NDArray[np.void]:
        """Return the step edges that moved a motor, of one axis or of all."""
        steps = self.of_kind("step")
        moved = steps["enabled"] == 1
        if axis is not None:
            moved &= steps["axis"] == AXES.index(axis)
        found: NDArray[np.void] = steps[moved]
        return found

    def positions(self) -> dict[str, int]:
        """Return the sum of steps by axis."""
        return {axis: int(self.steps(axis)["direction"].sum(dtype=np.int64)) for axis in AXES}

    def last_edge_s(self) -> float:
        """Return the time of the last motor step, s on ``time.monotonic()``; 0 if none."""
        steps = self.steps()
        return float(steps["ns"].max()) / 1e9 if len(steps) else 0.0

    def first_edge_s(self) -> float:
        """Return the time of the first motor step, s on ``time.monotonic()``; 0 if none."""
        steps = self.steps()
        return float(steps["ns"].min()) / 1e9 if len(steps) else 0.0

    def longest_gap_s(self) -> float:
        """Return the longest time between two successive steps, s."""
        times = self.steps()["ns"]
        return float(np.diff(times.astype(np.int64)).max()) / 1e9 if len(times) > 1 else 0.0


def read_step_log(path: Path) -> StepLog:
    """Read a log; a torn last record and room not yet written are dropped."""
    whole = path.stat().st_size // RECORD.itemsize
    records = np.memmap(path, RECORD, "r", shape=(whole,)) if whole else np.empty(0, RECORD)
    end = int(np.searchsorted(records["ns"] == 0, True)) if whole else 0
    return StepLog(np.array(records[:end]))
