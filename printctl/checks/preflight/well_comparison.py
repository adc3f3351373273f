"""Check that a well's moves in a plate job equal those of the same part printed alone."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath.gcode.numbers import decimals_for
from firmware_profiles import Printer
from kernels.arrays import FloatArray
from printctl.checks.set_up.check import Check
from sim.gcode.program.gcode import Program
from sim.gcode.program.modal import MOVE

_ROUNDINGS: Final = 2.5
"""Units of a text's last decimal by which a way may differ: either end, in either file."""


def compare_well_moves(
    well: str,
    plate: tuple[Program, NDArray[np.bool_]],
    alone: tuple[Program, NDArray[np.bool_]],
    moved_mm: FloatArray,
    printer: Printer,
) -> Check:
    """Compare the moves of some lines of one job with those of another.

    Parameters
    ----------
    well : str
    plate, alone : Program and (rows,) bool
        Each with the rows that are the part's own.
    moved_mm : (3,) float64, mm
        From the job by itself to the plate's.
    printer : Printer
        Which says how many decimals a file has.
    """
    digits = decimals_for(printer)
    allowed = _ROUNDINGS * 10.0 ** -min(digits.x, digits.y, digits.z)
    here, there = _moves(*plate), _moves(*alone)
    same = len(here[0]) == len(there[0])
    off = float(np.abs(here[0] - there[0] - moved_mm).max(initial=0.0)) if same else np.inf
    pushed = float(np.abs(here[1] - there[1]).max(initial=0.0)) if same else np.inf
    differences = {
        "mm": (off, allowed),
        "mm of the plunger": (pushed, _ROUNDINGS * 10.0**-digits.e),
    }
    if not same:
        differences = {"moves": (float(abs(len(here[0]) - len(there[0]))), 0.0)}
    unit, (value, limit) = max(differences.items(), key=lambda one: one[1][0] - one[1][1])
    return Check(
        "wells against the same part alone, whose needle and lumens were looked at",
        value,
        limit,
        unit,
        value <= limit,
        f"well {well}",
        "the plate's job isn't what was checked, which is a fault of ours: don't print it, and "
        "tell us with the recipe",
    )


def _moves(program: Program, rows: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    chosen = rows & (program.kind == MOVE)
    return program.target[chosen, :3], program.pushed[chosen]
