"""Checks of dish and bath: walls, floor and depth against the needle's moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_profiles import Bath, Needle
from kernels.arrays import FloatArray
from printctl.checks.preflight.wall_gaps import PlaceNames, hub_check, wall_check
from printctl.checks.set_up.check import Check
from printctl.checks.set_up.placed_dish import PlacedDish
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE

_TINY_MM: Final = 1e-6


def floor_check(run: DryRun, bath: Bath, floor_mm: float) -> Check:
    """Check the tip's least distance from the dish's floor."""
    value = float(run.low_mm[2]) - floor_mm
    return Check(
        "lowest tip above the dish's floor",
        value,
        bath.floor_clearance_mm,
        "mm",
        value >= bath.floor_clearance_mm - _TINY_MM,
        f"line {int(run.low_line[2])}",
        "the needle could touch the dish (bath: floor_clearance_mm); raise the part (place_mm)",
    )


def unknown_dish() -> Check:
    """Nobody said which dish: its walls and the bath's depth can't be looked at."""
    return Check(
        "dish",
        0,
        0,
        "",
        False,
        "printer.dish, --dish",
        "none is named, so walls and depth of the bath weren't looked at; name it, or see for "
        "yourself that the needle clears the wall",
        "warns",
    )


def dish_checks(
    run: DryRun, standing: PlacedDish, needle: Needle, ink_ul: float = 0.0
) -> list[Check]:
    """Walls for every move of needle or hub below their top; depth where it is known.

    Parameters
    ----------
    run : DryRun
    standing : PlacedDish
    needle : Needle
    ink_ul : float, µL
        Written into the bath, which rises by it.
    """
    tips, moves = tips_of(run), run.program.kind == MOVE
    lines = _Lines(run)
    checks = [
        wall_check(tips, moves, standing, needle, lines),
        hub_check(tips, moves, standing, needle, lines),
    ]
    if standing.bath_mm is not None:
        checks += _depth(run, standing, needle, ink_ul)
    return checks


@dataclass(frozen=True)
class _Lines(PlaceNames):
    """Line of the file of each row."""

    run: DryRun

    def __getitem__(self, row: int) -> str:
        return f"line {int(self.run.program.line[row])}"


def tips_of(run: DryRun) -> FloatArray:
    """Tip before and after each row, (n, 2, 3)."""
    ends = run.program.target[:, :3]
    begins = run.program.before[:, :3]
    return np.stack([begins, ends], axis=1)


def _depth(run: DryRun, standing: PlacedDish, needle: Needle, ink_ul: float) -> list[Check]:
    surface = standing.floor_mm + (standing.bath_mm or 0.0)
    dish, tips = standing.dish, tips_of(run)
    written = run.doses & (np.linalg.norm(np.diff(tips, axis=1)[:, 0], axis=1) > 0)
    heights = np.where(written, tips[:, :, 2].max(axis=1), -np.inf)
    row = int(heights.argmax()) if written.any() else -1
    top = float(heights[row]) if row >= 0 else standing.floor_mm
    deepest = surface - float(run.low_mm[2])
    risen = standing.risen_mm(needle, deepest, ink_ul)
    return [
        Check(
            "depth of the bath with ink and needle in it, below the dish's wall",
            risen,
            dish.wall_mm,
            "mm",
            risen <= dish.wall_mm,
            standing.bath_key,
            f"{dish.name} would run over; fill less or take a higher dish",
        ),
        Check(
            "highest writing, below the bath's surface",
            top,
            surface,
            "mm",
            top <= surface + _TINY_MM,
            f"line {int(run.program.line[row])}" if row >= 0 else "",
            "it would write in the air; fill more (bath_depth_mm) or lower the part",
        ),
        Check(
            "deepest tip below the bath's surface, against the needle",
            deepest,
            needle.length_mm,
            "mm",
            deepest <= needle.length_mm + _TINY_MM,
            f"line {int(run.low_line[2])}",
            f"the hub of {needle.name} would dip into the bath; take a longer needle or less bath",
        ),
    ]
