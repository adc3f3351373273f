"""Compute the ink volume that each G-code row pushes out of the head in use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from firmware_profiles import Printer, ProfileError, steady_flow
from kernels.arrays import FloatArray
from printctl.checks.set_up import HeadLoading
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE


def volumes(run: DryRun, printer: Printer, loads: Sequence[HeadLoading]) -> FloatArray:
    """Ink pushed out by each row of the program, of the head in use, (rows,), µL.

    Of a pneumatic head whose needle nobody named, at whose flow one can only guess, the ink's
    lines have no thickness.
    """
    program = run.program
    if printer.pneumatic is None:
        bore = [np.pi / 4 * one.syringe.inner_mm**2 * one.ink.flow_factor for one in loads]
        return np.asarray(program.pushed * np.array(bore)[program.tool])
    needle = loads[0].needle
    flow = steady_flow(printer.pneumatic, loads[0].ink, needle).ul_s if needle else 0.0
    ends = np.vstack([program.start[None, :3], program.target[:, :3]])
    length = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    lasts = np.divide(length, program.feed, out=np.zeros(len(length)), where=program.feed > 0)
    return np.where(run.doses & (program.kind == MOVE), flow * lasts, 0.0)


def written_ul(run: DryRun, printer: Printer, loads: Sequence[HeadLoading]) -> float:
    """What comes out of all heads in the whole run, µL; nothing where the pressure moves no ink."""
    try:
        return float(volumes(run, printer, loads).sum())
    except ProfileError:  # said by a check of its own
        return 0.0
