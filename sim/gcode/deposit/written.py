"""Select executed blocks that write ink; compute their volume and smoothed cross-section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.errors import DepositError
from sim.gcode.deposit.kernels import writing_runs
from sim.gcode.deposit.strands import Strands
from sim.gcode.motion.executed import ExecutedMotion


@dataclass(frozen=True)
class Written:
    """Lines as dosed, and the blocks that wrote them.

    Attributes
    ----------
    lines : Strands
    block : (n,) int64
        Of the executed motion, ascending.
    standing_ul : float, µL
        Net of primes and retractions, which deposit nothing.
    """

    lines: Strands
    block: IntArray
    standing_ul: float

    @property
    def written_ul(self) -> float:
        """Dosed while writing, µL."""
        return float(self.lines.dose_ul.sum())


def written(
    executed: ExecutedMotion,
    plunger_area_mm2: float,
    smoothing_mm: float = 1.0,
    plunger_step_mm: float | None = None,
) -> Written:
    """Return the lines that an executed motion writes.

    Parameters
    ----------
    executed : ExecutedMotion
        Of one head.
    plunger_area_mm2 : float, mm²
    smoothing_mm : float, mm
        Length of path over which the plunger's steps are smoothed.
    plunger_step_mm : float or None, mm
        As of `sim.gcode.deposit.lay.deposit`.

    Raises
    ------
    DepositError
        When nothing is written, or an area or length isn't above 0.
    """
    check_positive(plunger_area_mm2=plunger_area_mm2, smoothing_mm=smoothing_mm)
    plunger = executed.plunger_end - executed.plunger_start
    length = np.linalg.norm(executed.end - executed.start, axis=1)
    run = _runs(executed, length, plunger, smoothing_mm, plunger_step_mm)
    chosen = np.flatnonzero(run >= 0)
    # Pressure lives through a short travel, but not through a retraction.
    stretch = np.cumsum(plunger < 0, dtype=np.int64)[chosen]
    dose = plunger[chosen] * plunger_area_mm2
    area = _smoothed_area(stretch, length[chosen], dose, smoothing_mm)
    kept = area > 0
    chosen = chosen[kept]
    lines = Strands(
        executed.start[chosen],
        executed.end[chosen],
        dose[kept],
        area[kept],
        run[chosen],
        executed.line[chosen],
    )
    laid = float(plunger[chosen].sum()) * plunger_area_mm2
    return Written(lines, chosen, float(plunger.sum()) * plunger_area_mm2 - laid)


def check_positive(**values: float) -> None:
    """Raise `DepositError` for a value that isn't a number above 0."""
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise DepositError(f"{name} is {value:g}; it must be a number above 0")


def _runs(
    executed: ExecutedMotion,
    length: FloatArray,
    plunger: FloatArray,
    smoothing: float,
    step: float | None,
) -> IntArray:
    """Number of each block's stretch of writing; -1 for blocks that don't write."""
    pushed = plunger[(plunger > 0) & (length > 1e-9)].sum()
    if pushed <= 0:
        raise DepositError(
            "no block moves the needle while the plunger advances, so nothing was deposited; "
            "check that the job extrudes and that the extruder was hot enough to be allowed to"
        )
    move = executed.end - executed.start
    # Bridging freely first, to learn how much path one step of the plunger makes.
    run = writing_runs(length, plunger, move, smoothing / 2)
    quantum = _plunger_quantum(plunger) if step is None else step
    path_of_step = quantum * length[run >= 0].sum() / plunger[run >= 0].sum()
    return writing_runs(length, plunger, move, min(1.5 * path_of_step, smoothing / 2))


def _plunger_quantum(plunger: FloatArray) -> float:
    """Smallest difference between plunger travels: one motor step, if the motion is varied."""
    sizes = np.unique(np.round(np.abs(plunger), 7))
    steps = np.diff(np.concatenate([[0.0], sizes]))
    return float(steps[steps > 1e-6].min())


def _smoothed_area(
    stretch: IntArray, length: FloatArray, volume: FloatArray, smoothing: float
) -> FloatArray:
    """Cross-section (n,), mm²: volume per length over a window around each block's middle.

    The window is `smoothing` or the block itself, whichever is longer, and ends where the
    stretch between two retractions does.
    """
    path = np.concatenate([[0.0], np.cumsum(length)])
    dosed = np.concatenate([[0.0], np.cumsum(volume)])
    first = np.searchsorted(stretch, stretch, side="left")
    last = np.searchsorted(stretch, stretch, side="right")
    middle = (path[:-1] + path[1:]) / 2
    half = np.maximum(smoothing, length) / 2
    low = np.maximum(middle - half, path[first])
    high = np.minimum(middle + half, path[last])
    taken = np.interp(high, path, dosed) - np.interp(low, path, dosed)
    return np.asarray(taken / (high - low))
