"""Data class of the simulated printer's executed motion: tip, plunger, times; save and load."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Printer
from gcode.motion.state import Records
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class ExecutedMotion:
    """Blocks in the order in which the planner ran them.

    Positions are those of the step counters (whole steps), so quantisation is in them.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
        Needle tip in the printer's frame; of several heads the first one's, lowered (`of_head`
        gives where another's was).
    plunger_start, plunger_end : (n,) float64, mm
        Physical travel of the head's plunger since power-up (G92 doesn't move it).
    time_start, time_end : (n,) float64, s
        On the printer's own clock.
    line : (n,) int64
        Zero-based number of the job's command line that made the block; -1 when unknown, or a
        host's own. Of a simulated printer that doesn't know the job (`sim.devices.board.printer`)
        the number of the line that came, which counts a host's own lines;
        `gcode.heads` finds the job's.
    tool : (n,) int64
        The head whose plunger E moved; zeros where not given.
    """

    start: FloatArray
    end: FloatArray
    plunger_start: FloatArray
    plunger_end: FloatArray
    time_start: FloatArray
    time_end: FloatArray
    line: NDArray[np.int64]
    tool: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        if len(self.tool) != len(self.line) and not len(self.tool):
            object.__setattr__(self, "tool", np.zeros(len(self.line), np.int64))

    def of_head(self, number: int, offset_mm: tuple[float, float, float]) -> ExecutedMotion:
        """Blocks of one head, with the places of its own tip.

        Parameters
        ----------
        offset_mm : tuple, mm
            Of its tip from the first head's, both lowered (`firmware_profiles.Head.offset_mm`).
        """
        own, offset = self.where(self.tool == number), np.asarray(offset_mm)
        return replace(own, start=own.start + offset, end=own.end + offset)

    def where(self, chosen: NDArray[np.bool_]) -> ExecutedMotion:
        """Some of the blocks, (n,)."""
        return ExecutedMotion(**{one.name: getattr(self, one.name)[chosen] for one in fields(self)})

    def __len__(self) -> int:
        return len(self.line)

    def save(self, path: Path) -> None:
        """Write as ``.npz`` by way of a temporary file."""
        draft = path.with_name(f".{path.stem}.{os.getpid()}.part.npz")
        try:
            np.savez(draft, **{item.name: getattr(self, item.name) for item in fields(self)})
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)

    @staticmethod
    def load(path: Path) -> ExecutedMotion:
        """Read what `save` wrote."""
        with np.load(path) as data:
            return ExecutedMotion(**{name: data[name] for name in data.files})


_NOWHERE: Final = np.zeros((0, 3))
_NEVER: Final = np.zeros(0)
NO_MOTION: Final = ExecutedMotion(
    _NOWHERE, _NOWHERE, _NEVER, _NEVER, _NEVER, _NEVER, np.zeros(0, np.int64)
)
"""Of a printer that hasn't moved yet."""


def executed_motion(log: Records, printer: Printer) -> ExecutedMotion:
    """Blocks that ran, (n,) of `LOG`, in mm and s."""
    axes = printer.steps_per_mm
    per_mm = np.array([axes.x, axes.y, axes.z])
    heads = range(printer.head_count)
    plunger = np.array([printer.of_head(number).steps_per_mm.e for number in heads])[log["tool"]]
    return ExecutedMotion(
        start=log["start"][:, :3] / per_mm,
        end=log["end"][:, :3] / per_mm,
        plunger_start=log["start"][:, 3] / plunger,
        plunger_end=log["end"][:, 3] / plunger,
        time_start=log["time_start"].copy(),
        time_end=log["time_end"].copy(),
        line=log["line"].copy(),
        tool=log["tool"].copy(),
    )


def window_sums(
    stretch: IntArray, length: FloatArray, window_mm: float, *values: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Return sums of values over a window of path around each piece's middle, and its way, mm.

    Parameters
    ----------
    stretch : (n,) int64
        Ascending; a window stays within its piece's stretch.
    length : (n,) float64, mm
        A longer piece than the window is a window of its own.
    values : (n,) float64 each
        Spread evenly over their pieces.
    """
    path = np.concatenate([[0.0], np.cumsum(length)])
    first = np.searchsorted(stretch, stretch, side="left")
    last = np.searchsorted(stretch, stretch, side="right")
    middle = (path[:-1] + path[1:]) / 2
    half = np.maximum(window_mm, length) / 2
    low = np.maximum(middle - half, path[first])
    high = np.minimum(middle + half, path[last])
    totals = [np.concatenate([[0.0], np.cumsum(each)]) for each in values]
    return [np.interp(high, path, each) - np.interp(low, path, each) for each in totals], high - low
