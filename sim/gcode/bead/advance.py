"""Compute the plunger's lead over E by the firmware's pressure advance, per executed move.

With advance K the plunger stands at E + K dE/dt while a move pushes ink along a way. Known by
Marlin as M900 K, by RepRapFirmware as M572 S, by Klipper as SET_PRESSURE_ADVANCE ADVANCE=; it may
also stand in the firmware's own configuration (`advance_s` of the printer's profile). Sources:
marlinfw.org/docs/gcode/M900.html, docs.duet3d.com (M572), www.klipper3d.org/Kinematics.html
(pressure advance). The planner of `sim.gcode.motion.planner` leaves it out, so that it is put in
here, once.

Modelled: the plunger is ahead by K times the E speed that the block's mean speed asks for, in
moves that push ink and move the tip (Klipper: in x or y). Not modelled: Klipper's smoothing over
`pressure_advance_smooth_time` (0.04 s), Marlin's restriction of changes to acceleration phases,
limits of the plunger's speed while it catches up.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from firmware_profiles import Printer
from firmware_profiles.families import family_of
from kernels.arrays import FloatArray
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.gcode import Program


@dataclass(frozen=True)
class Advance:
    """Plunger advance added by the firmware.

    Attributes
    ----------
    ahead_mm : (n,) float64, mm
        By how much the plunger is ahead of E in each executed block.
    most_s : float, s
        Largest K in force.
    """

    ahead_mm: FloatArray
    most_s: float


def advance_of(run: DryRun, gcode: bytes, printer: Printer) -> Advance:
    """Advance in force in each executed block of a dry run (of all heads, or of one)."""
    program, executed = run.program, run.executed
    factor = _factors(program, gcode, printer)
    if not factor.any() or not len(executed):
        return Advance(np.zeros(len(executed)), 0.0)
    ratio = _plunger_per_mm(program, across=family_of(printer).advances_across_only) * factor
    row = np.searchsorted(program.command, executed.line)
    known = (executed.line >= 0) & (row < len(program))
    way = np.linalg.norm(executed.end - executed.start, axis=1)
    lasts = np.maximum(executed.time_end - executed.time_start, 1e-9)
    ahead = np.where(known, ratio[np.minimum(row, len(program) - 1)] * way / lasts, 0.0)
    return Advance(ahead, float(factor.max()))


def _factors(program: Program, gcode: bytes, printer: Printer) -> FloatArray:
    """K at each row of the program, s."""
    lines, values = [0], [printer.advance_s]
    pattern = family_of(printer).advance
    if pattern and re.search(pattern, gcode, re.IGNORECASE):
        for number, line in enumerate(gcode.splitlines(), start=1):
            match = re.match(rb"\s*(?:N\d+\s*)?" + pattern, line, re.IGNORECASE)
            if match:
                lines.append(number)
                values.append(float(match[1]))
    at = np.searchsorted(lines, program.line, side="right") - 1
    return np.asarray(values, dtype=np.float64)[at]


def _plunger_per_mm(program: Program, *, across: bool) -> FloatArray:
    """Travel of the plunger over way of the tip, where a row pushes on its way, else 0."""
    begin = program.before[:, :3]
    way = program.target[:, :3] - begin
    length = np.linalg.norm(way, axis=1)
    counts = (program.pushed > 0) & (length > 1e-6)
    if across:
        counts &= np.linalg.norm(way[:, :2], axis=1) > 1e-6
    return np.where(counts, program.pushed / np.maximum(length, 1e-6), 0.0)
