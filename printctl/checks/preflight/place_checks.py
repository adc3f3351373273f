"""Check that a job doesn't redefine its X, Y or Z coordinates (G92) after its first move.

A later place with other numbers renames all places: the firmware's own limits, and what a person
reads from its display, are then off by as much. E is free: it counts a plunger.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from firmware_profiles import Printer
from firmware_profiles.families import meanings
from firmware_profiles.families.grammar import Meaning
from printctl.checks.set_up.check import Check
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE
from sim.gcode.reading import GcodeLine

_SAME_MM: Final = 1e-3
_AXES: Final = "XYZ"


def place_checks(run: DryRun, printer: Printer) -> list[Check]:
    """A row for the first place that the job tells anew with other numbers."""
    for number, axis, stated, stands in _told_anew(run):
        return [
            Check(
                f"place of {axis} told anew",
                stated,
                stands,
                "mm",
                False,
                f"line {number}",
                f"{axis} stands at {stands:g} mm there, by {printer.name}'s count of the start; "
                "tell X, Y and Z once, before the first move, and take this out (E may be counted "
                "anew)",
            )
        ]
    return []


def _told_anew(run: DryRun) -> Iterator[tuple[int, str, float, float]]:
    """Yield line, axis, what is told, and where it stands by the job's own count."""
    program = run.program
    moves = program.line[program.kind == MOVE]
    first = int(moves.min()) if moves.size else 0
    shift, by_g92 = dict[str, float](), set[str]()
    for number, line in run.others:
        stated = _places(line)
        row = int(np.searchsorted(program.line, number)) if stated else 0
        for axis, value in stated.items():
            at = _stood(run, row)[_AXES.index(axis)]
            by_name = line.code != "G92"
            stands = at + shift.setdefault(axis, value - at if number < first or not first else 0.0)
            if by_name and axis in by_g92 and abs(shift[axis]) > _SAME_MM:
                stands = at  # G92's shift comes on top of what the command tells
            by_g92 |= set() if by_name else {axis}
            if abs(value - stands) > _SAME_MM:
                yield number, axis, value, stands


def _stood(run: DryRun, row: int) -> list[float]:
    """Where the tip stands before a row, mm, by the count of the start."""
    before = run.program.target[row - 1] if row > 0 else run.program.start
    return [float(mm) for mm in before[:3]]


def _places(line: GcodeLine) -> dict[str, float]:
    """Axes that a line says the tip stands at, mm."""
    if line.code == "G92":
        return {axis: mm for axis in _AXES if (mm := line.number(axis)) is not None}
    if meanings().get(line.code) is not Meaning.PLACES:
        return {}
    return {axis: float(line.parameters[axis]) for axis in _AXES if axis in line.parameters}
