"""Whether a well's lines in a plate's job do what its own job does, which was checked by itself."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from printctl.preflight.check import Check
from sim.gcode import Program
from sim.gcode_modal import MOVE

FloatArray = NDArray[np.float64]
ALLOWED_MM: Final = 0.0025
"""Two roundings to whole microns."""
_PLUNGER_MM: Final = 1e-4


def same_as_alone(
    well: str,
    plate: tuple[Program, NDArray[np.bool_]],
    alone: tuple[Program, NDArray[np.bool_]],
    moved_mm: FloatArray,
) -> Check:
    """Compare the moves of some lines of one job with those of another.

    Parameters
    ----------
    well : str
    plate, alone : Program and (rows,) bool
        Each with the rows that are the part's own.
    moved_mm : (3,) float64, mm
        From the job by itself to the plate's.
    """
    here, there = _moves(*plate), _moves(*alone)
    same = len(here[0]) == len(there[0])
    off = float(np.abs(here[0] - there[0] - moved_mm).max(initial=0.0)) if same else np.inf
    pushed = float(np.abs(here[1] - there[1]).max(initial=0.0)) if same else np.inf
    return Check(
        "wells against the same part alone, whose needle and lumens were looked at",
        off if np.isfinite(off) else float(abs(len(here[0]) - len(there[0]))),
        ALLOWED_MM,
        "mm" if same else "moves",
        off <= ALLOWED_MM and pushed <= _PLUNGER_MM,
        f"well {well}",
        "the plate's job isn't what was checked, which is a fault of ours: don't print it, and "
        "tell us with the recipe",
    )


def _moves(program: Program, rows: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    found = rows & (program.kind == MOVE)
    return program.target[found, :3], program.pushed[found]
