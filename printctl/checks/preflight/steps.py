"""Check motor step size and E rounding against the bead: warn if too coarse.

Plunger steps come one after the other along a bead, however many moves it is cut into. The volume
of one step spreads over the bead that syringe and ink smooth (`SMOOTHING_MM`, as the simulated
deposit takes it); a step that fills more bead than that shows as a blob. An unbroken bead that
takes less than one step gets a whole step or none. Nothing is refused for it: the sum stays right,
and `printctl.checks.lumens` measures what the rounded doses leave open.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from firmware_profiles import Printer, Syringe
from gcode.deposit.written import SMOOTHING_MM, Strands
from gcode.dry_run.run import DryRun
from gcode.program.modal import MOVE
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Check
from printctl.rounding import last_digit_mm

_STILL_MM: Final = 1e-6
_ROUNDING: Final = 1e-6
MAX_ROUNDED_SHARE: Final = 0.01
"""Of the ink: on the shared first parts up to 0.15 % is in beads of less than a step."""


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


def single_step_share(wrote: Strands, printer: Printer, syringe: Syringe) -> float:
    """Return the share of writing moves that get at most one plunger step."""
    return float((wrote.dose_ul <= syringe.area_mm2 / printer.steps_per_mm.e).mean())


def _axis_step(wrote: Strands, printer: Printer) -> Check:
    steps = printer.steps_per_mm
    rises = (np.abs(wrote.end[:, 2] - wrote.start[:, 2]) > _STILL_MM).any()
    step = max(1 / steps.x, 1 / steps.y, 1 / steps.z if rises else 0.0)
    at = int(wrote.length.argmin())
    shortest = float(wrote.length[at])
    fine = step <= shortest * (1 + _ROUNDING)
    return _step_check(
        "axis motor step vs. shortest extrusion move",
        step,
        shortest,
        "mm",
        fine,
        int(wrote.line[at]),
        f"{int((wrote.length < step).sum())} moves are shorter than a step, so their end points "
        "are rounded; merge them or use finer steps (steps_per_mm)",
    )


def _plunger_step(wrote: Strands, printer: Printer, syringe: Syringe) -> Check:
    """Bead length per plunger step, at the file's mean cross-section."""
    plunger = wrote.dose_ul.sum() / syringe.area_mm2
    bead_mm = float(wrote.length.sum() / plunger) / printer.steps_per_mm.e
    return _step_check(
        "bead length per plunger step",
        bead_mm,
        SMOOTHING_MM,
        "mm",
        bead_mm <= SMOOTHING_MM,
        int(wrote.line[0]),
        f"syringe and ink smooth out steps up to about {SMOOTHING_MM:g} mm of bead; longer ones "
        "show as blobs; use a narrower syringe or finer steps (steps_per_mm.e)",
    )


def _least_dose(wrote: Strands, run: DryRun, printer: Printer, syringe: Syringe) -> Check:
    """Share of the ink in unbroken beads of less than a step, or than E's last digit."""
    dose = np.bincount(wrote.stroke, wrote.dose_ul) / syringe.area_mm2
    first = np.searchsorted(wrote.stroke, np.arange(len(dose)))
    step, digit = 1 / printer.steps_per_mm.e, last_digit_mm(run.program.plunger)
    coarse = max(step, digit)
    short = dose < coarse * (1 - _ROUNDING)
    share = float(dose[short].sum() / dose.sum())
    what, remedy = "one plunger step", "use a narrower syringe or finer steps (steps_per_mm.e)"
    if digit > step:
        what, remedy = "E's last digit", "write E with more digits"
    return _step_check(
        f"ink in beads of less than {what}",
        100 * share,
        100 * MAX_ROUNDED_SHARE,
        "%",
        share <= MAX_ROUNDED_SHARE,
        int(wrote.line[first[dose.argmin()]]),
        f"{int(short.sum())} of {len(dose)} beads need less than "
        f"{1e3 * coarse * syringe.area_mm2:.3g} nL and get either that or nothing; {remedy}",
    )


def _step_check(
    name: str, value: float, limit: float, unit: str, passed: bool, line: int, remedy: str
) -> Check:
    return Check(Kind.STEPS, name, value, limit, unit, passed, f"line {line}", remedy, "warns")
