"""Checks of a plate job: each well's walls, floor and bath, and travels over the rims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Dish, Needle
from kernels.arrays import FloatArray, IntArray
from printctl.checks.preflight.dish import tips_of
from printctl.checks.preflight.wall_gaps import hub_gap, hub_remedy, wall_gap
from printctl.checks.set_up import WALL_CLEARANCE_MM, Check, PlacedDish
from sim.gcode.dry_run.run import DryRun
from sim.gcode.program.modal import MOVE

_TINY_MM: Final = 1e-6


@dataclass(frozen=True)
class Wells:
    """The wells of a plate as they stand.

    Attributes
    ----------
    names : sequence of str
        All that the plate has.
    centre_mm : (w, 2) float64, mm
        Printer's frame.
    dish : Dish
        Any of them.
    floor_mm : float, mm
    bath_mm : float or None, mm
    safe_z_mm : float, mm
        From where a tip is clear of every rim.
    ink_ul : mapping of str to float, µL
        What is written into each well that is printed in.
    """

    names: Sequence[str]
    centre_mm: FloatArray
    dish: Dish
    floor_mm: float
    bath_mm: float | None
    safe_z_mm: float
    ink_ul: Mapping[str, float]

    def standing(self, number: int) -> PlacedDish:
        """One well as a dish."""
        x, y = self.centre_mm[number].tolist()
        return PlacedDish(self.dish, (x, y), self.floor_mm, self.bath_mm)

    def nearest(self, tips: FloatArray) -> IntArray:
        """The well whose middle is nearest to each place, (…,)."""
        off = tips[..., None, :2] - self.centre_mm
        return np.asarray((off**2).sum(axis=-1).argmin(axis=-1))


def well_checks(run: DryRun, wells: Wells, needle: Needle) -> list[Check]:
    """Every well that the needle goes into, and every way below the plate's rims.

    Of each question the answers that don't pass stand one by one, each with its well; where all
    pass, the one that comes nearest to its limit.
    """
    tips, moves = tips_of(run), run.program.kind == MOVE
    low = moves & (tips[:, :, 2].min(axis=1) < wells.safe_z_mm - _TINY_MM)
    near = wells.nearest(tips)
    checks = [_crossing(run, wells, tips, low & (near[:, 0] != near[:, 1]))]
    asked = [
        _of_well(run, wells, needle, number, low & (near == number).any(axis=1))
        for number in np.unique(near[low]).tolist()
    ]
    for name in dict.fromkeys(check.check for group in asked for check in group):
        checks += _worst([check for group in asked for check in group if check.check == name])
    return checks


def _worst(checks: Sequence[Check]) -> list[Check]:
    failed = [check for check in checks if not check.passed]
    return failed or [min(checks, key=_room)]


def _room(check: Check) -> float:
    return abs(check.value - check.limit)


def _crossing(run: DryRun, wells: Wells, tips: FloatArray, across: NDArray[np.bool_]) -> Check:
    """Ways from one well to another must be above the rims."""
    height = np.where(across, tips[:, :, 2].min(axis=1), np.inf)
    row = int(height.argmin()) if len(height) else -1
    crosses = row >= 0 and bool(across.any())
    return Check(
        "ways between wells, above the plate's rims",
        float(height[row]) if crosses else wells.safe_z_mm,
        wells.safe_z_mm,
        "mm",
        not crosses,
        f"line {int(run.program.line[row])}" if crosses else "",
        "the needle would drag through the wells' walls; go over them (height_mm of the plate, and "
        "what is kept above it)",
    )


def _of_well(
    run: DryRun, wells: Wells, needle: Needle, number: int, rows: NDArray[np.bool_]
) -> list[Check]:
    """Checks of one well; ``rows`` are the moves that begin or end at it below the rims."""
    name, standing, tips = wells.names[number], wells.standing(number), tips_of(run)
    if name not in wells.ink_ul:
        line = int(run.program.line[np.flatnonzero(rows)[0]])
        return [
            Check(
                "wells entered in which nothing is printed",
                1,
                0,
                "",
                False,
                f"well {name}, line {line}",
                "the needle goes down where no part is; see the plate's place (a1_mm, turned_deg)",
            )
        ]
    at = _Well(run, name, rows, tips)
    tall = replace(
        standing,
        dish=standing.dish.model_copy(update={"wall_mm": wells.safe_z_mm - wells.floor_mm}),
    )
    checks = [
        at.least(
            "needle to its well's wall",
            wall_gap(tips, rows, tall, needle.outer_mm),
            standing.dish.inner_x_mm / 2,
            f"it would run into the wall of {standing.dish.name}; take a plate with wider wells, "
            "or see where the plate stands (a1_mm, turned_deg)",
        ),
        at.least(
            "needle's hub to its well's wall",
            hub_gap(tips, rows, standing, needle),
            standing.dish.inner_x_mm / 2,
            hub_remedy(needle, standing.dish),
        ),
    ]
    if standing.bath_mm is None:
        return checks
    return checks + _bath(at, standing, needle, wells.ink_ul[name])


@dataclass(frozen=True)
class _Well:
    run: DryRun
    name: str
    rows: NDArray[np.bool_]
    tips: FloatArray

    def place(self, row: int) -> str:
        return f"well {self.name}, line {int(self.run.program.line[row])}"

    def least(self, check: str, gap: FloatArray, none: float, remedy: str) -> Check:
        """A least distance against the clearance; ``none`` where nothing comes below the rim."""
        row = int(gap.argmin())
        value = float(gap[row]) if np.isfinite(gap[row]) else none
        passed = value >= WALL_CLEARANCE_MM
        return Check(check, value, WALL_CLEARANCE_MM, "mm", passed, self.place(row), remedy)


def _bath(at: _Well, standing: PlacedDish, needle: Needle, ink_ul: float) -> list[Check]:
    """Rise of the bath, its surface, and the hub above it."""
    surface = standing.floor_mm + (standing.bath_mm or 0.0)
    tips, dish = at.tips, standing.dish
    moved = np.linalg.norm(np.diff(tips, axis=1)[:, 0], axis=1) > 0
    written = at.rows & at.run.doses & moved
    tops = np.where(written, tips[:, :, 2].max(axis=1), -np.inf)
    lows = np.where(at.rows, tips[:, :, 2].min(axis=1), np.inf)
    top, low = float(tops.max()), float(lows.min())
    risen = standing.risen_mm(needle, surface - low, ink_ul)
    return [
        Check(
            "depth of a well's bath with ink and needle in it, below its rim",
            risen,
            dish.wall_mm,
            "mm",
            risen <= dish.wall_mm,
            f"well {at.name}, plate.bath_depth_mm",
            f"{dish.name} would run over; fill less or take a plate with deeper wells",
        ),
        Check(
            "highest writing in a well, below the bath's surface",
            top if written.any() else standing.floor_mm,
            surface,
            "mm",
            not written.any() or top <= surface + _TINY_MM,
            at.place(int(tops.argmax())),
            "it would write in the air; fill the wells higher (plate.bath_depth_mm) or take a "
            "flatter part",
        ),
        Check(
            "deepest tip in a well below the bath's surface, against the needle",
            surface - low,
            needle.length_mm,
            "mm",
            surface - low <= needle.length_mm + _TINY_MM,
            at.place(int(lows.argmin())),
            f"the hub of {needle.name} would dip into the bath; take a longer needle or less bath",
        ),
    ]
