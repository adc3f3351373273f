"""Distinguish clog, empty syringe, bubble and lost line by where ink is missing in writing order.

What is seen along the lines is put in the order of writing. Ink that is missing up to the last
place written hasn't come back: the syringe is empty if the plunger says so, else something is
stuck. Only where exactly one path is missing behind sound ones it may as well be a line that didn't
stick, and the next look tells. Ink that came back after a while was a bubble, or, where exactly one
path is missing, a line that didn't stick. A smooth deviation is none of these: the flow control's
affair.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray

_ABSENT: Final = 0.5
_STOPPED: Final = 10.0
"""Times the tolerated volume that must be missing at the end: less is the taper of a line's end."""
_STEADY: Final = 0.8
"""Share of a run's seen places that must lack ink."""


class SupplyState(StrEnum):
    """What the missing ink says of needle and syringe."""

    FLOWING = "flowing"
    BUBBLE = "bubble"
    LOST_LINE = "lost line"
    CLOGGED = "clogged"
    EMPTY = "empty"
    INTERMITTENT = "intermittent"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class InkSupply:
    """Outcome of `judge_supply`.

    Attributes
    ----------
    state : SupplyState
    missing_ul : float, µL
        Asked for in the runs without ink.
    since_ul : float or None, µL
        Asked for since the ink last came, where it hasn't come back.
    runs : int
        Stretches without ink.
    """

    state: SupplyState
    missing_ul: float
    since_ul: float | None
    runs: int

    @property
    def stopped(self) -> bool:
        """Whether no ink comes out of the needle any more."""
        return self.state in (SupplyState.CLOGGED, SupplyState.EMPTY)


def judge_supply(
    volume_ul: FloatArray,
    present: FloatArray,
    seen: BoolArray,
    stroke: IntArray,
    *,
    least_ul: float,
    left_ul: float | None = None,
) -> InkSupply:
    """Judge from the places along the lines, in the order of writing.

    Parameters
    ----------
    volume_ul : (n,) float64, µL
        Asked for at each place.
    present : (n,) float64
        0 (no ink) to 1.
    seen : (n,) bool
        Places that the picture tells of; the others are passed over.
    stroke : (n,) int64
        Unbroken path of each place.
    least_ul : float, µL
        Runs of less are within tolerance.
    left_ul : float, optional, µL
        What the plunger still had before the last of these places; None where nobody knows.
    """
    if not seen.any():
        return InkSupply(SupplyState.UNKNOWN, 0.0, None, 0)
    volume, lacks, path = volume_ul[seen], present[seen] < _ABSENT, stroke[seen]
    runs = [run for run in _runs(lacks) if volume[run].sum() >= least_ul]
    missing = float(sum(volume[run].sum() for run in runs))
    if not runs:
        return InkSupply(SupplyState.FLOWING, 0.0, None, 0)
    last = runs[-1]
    empty = left_ul is not None and left_ul <= least_ul
    lost = last.start > 0 and _whole_path(last, path) and not empty
    if last.stop == len(lacks) and volume[last].sum() >= _STOPPED * least_ul and not lost:
        state = SupplyState.EMPTY if empty else SupplyState.CLOGGED
        return InkSupply(state, missing, float(volume[last].sum()), len(runs))
    if len(runs) > 2:
        state = SupplyState.INTERMITTENT
    elif all(_whole_path(run, path) for run in runs):
        state = SupplyState.LOST_LINE
    else:
        state = SupplyState.BUBBLE
    return InkSupply(state, missing, None, len(runs))


def _runs(lacks: BoolArray) -> list[slice]:
    """Stretches without ink; single places with or without don't end one."""
    smooth = lacks.copy()
    if len(lacks) > 2:
        between = (lacks[:-2] == lacks[2:]) & (lacks[1:-1] != lacks[2:])
        smooth[1:-1] = np.where(between, lacks[2:], lacks[1:-1])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], smooth, [False]]).astype(np.int8)))
    runs = [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
    return [run for run in runs if lacks[run].mean() >= _STEADY or run.stop - run.start <= 2]


def _whole_path(run: slice, path: IntArray) -> bool:
    """Whether a run is one path, from its first to its last place."""
    own = np.flatnonzero(path == path[run.start])
    return bool(own[0] == run.start and own[-1] == run.stop - 1)
