"""Check motor step size and E rounding against the moves written: warn if too coarse.

A step that is longer than a move leaves the move's place or dose to rounding: the sum stays right,
what is written within the step wavers. Nothing is refused for it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from firmware_profiles import Printer, Syringe
from printctl.checks.set_up import Check
from printctl.rounding import last_digit_mm
from sim.gcode.deposit.written import Strands
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE

_STILL_MM: Final = 1e-6
_ROUNDING: Final = 1e-6


def step_checks(run: DryRun, printer: Printer, syringe: Syringe) -> list[Check]:
    """Warnings of steps that are coarse for this file; none where nothing is written."""
    wrote = writing_moves(run, syringe.area_mm2)
    if not len(wrote):
        return []
    checks = [_axis_step(wrote, printer)]
    if printer.pneumatic is None and wrote.dose_ul.sum() > 0:
        checks += [
            _plunger_step(wrote, printer, syringe),
            _least_dose(wrote, run, printer, syringe),
        ]
    return checks


def writing_moves(run: DryRun, ul_per_mm: float) -> Strands:
    """Return the file's moves that write; ``ul_per_mm``, mm², is the bore of the syringe."""
    program = run.program
    begin = program.before[:, :3]
    length = np.linalg.norm(program.target[:, :3] - begin, axis=1)
    writes = run.doses & (program.kind == MOVE) & (length > _STILL_MM)
    rows = np.flatnonzero(writes)
    breaks = np.cumsum(~writes & (program.kind == MOVE))[rows]
    return Strands.dosed(
        begin[rows],
        program.target[rows, :3],
        np.diff(program.plunger, prepend=0.0)[rows] * ul_per_mm,
        np.unique(breaks, return_inverse=True)[1].reshape(-1),
        program.line[rows],
    )


def _axis_step(wrote: Strands, printer: Printer) -> Check:
    steps = printer.steps_per_mm
    rises = (np.abs(wrote.end[:, 2] - wrote.start[:, 2]) > _STILL_MM).any()
    step = max(1 / steps.x, 1 / steps.y, 1 / steps.z if rises else 0.0)
    at = int(wrote.length.argmin())
    shortest = float(wrote.length[at])
    fine = step <= shortest * (1 + _ROUNDING)
    return _step_check(
        "motor step of an axis, against the shortest written move",
        step,
        shortest,
        "mm",
        fine,
        int(wrote.line[at]),
        f"{int((wrote.length < step).sum())} moves are shorter than a step and end where it "
        "rounds; merge them, or take finer steps (steps_per_mm)",
    )


def _plunger_step(wrote: Strands, printer: Printer, syringe: Syringe) -> Check:
    """The way of line that one step of the plunger makes, at the file's mean flow."""
    plunger = wrote.dose_ul.sum() / syringe.area_mm2
    way = float(wrote.length.sum() / plunger) / printer.steps_per_mm.e
    at = int(wrote.length.argmin())
    shortest = float(wrote.length[at])
    count = int((wrote.length < way).sum())
    return _step_check(
        "line that one step of the plunger makes, against the shortest written move",
        way,
        shortest,
        "mm",
        way <= shortest * (1 + _ROUNDING),
        int(wrote.line[at]),
        f"{count} of {len(wrote.length)} moves get a whole step or none: the line's width wavers "
        "over such a way unless syringe and ink smooth it; take a narrower syringe or finer steps",
    )


def _least_dose(wrote: Strands, run: DryRun, printer: Printer, syringe: Syringe) -> Check:
    """A step, or E's last digit, against the dose of the smallest unbroken line."""
    dose = np.bincount(wrote.stroke, wrote.dose_ul) / syringe.area_mm2
    first = np.searchsorted(wrote.stroke, np.arange(len(dose)))
    at = int(dose.argmin())
    step, digit = 1 / printer.steps_per_mm.e, last_digit_mm(run.program.plunger)
    coarse = max(step, digit)
    nl = 1e3 * syringe.area_mm2
    which = "E's last digit" if digit > step else "one step of the plunger"
    short = int((dose < coarse * (1 - _ROUNDING)).sum())
    return _step_check(
        f"{which}, against the least line's dose",
        coarse * nl,
        float(dose[at]) * nl,
        "nL",
        short == 0,
        int(wrote.line[first[at]]),
        f"{short} of {len(dose)} unbroken lines are less than that: they get a whole one or none, "
        "and only their sum is right; give E more digits, take a narrower syringe or finer steps",
    )


def _step_check(
    name: str, value: float, limit: float, unit: str, passed: bool, line: int, remedy: str
) -> Check:
    return Check(name, value, limit, unit, passed, f"line {line}", remedy, "warns")
