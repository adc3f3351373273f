"""The dish and the bath in it: walls, floor and depth against the needle's way."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Bath, Dish, Needle
from printctl.preflight.wall_gaps import hub_gap, wall_gap
from printctl.set_up.check import Check
from printctl.set_up.standing import HUB_MM, WALL_CLEARANCE_MM, Standing
from sim.dryrun import DryRun
from sim.gcode_modal import MOVE

FloatArray = NDArray[np.float64]
_TINY_MM: Final = 1e-6


def floor_check(run: DryRun, bath: Bath, floor_mm: float) -> Check:
    """How near the tip comes to the dish's floor."""
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
    run: DryRun, standing: Standing, needle: Needle, ink_ul: float = 0.0
) -> list[Check]:
    """Walls for every move of needle or hub below their top; depth where it is known.

    Parameters
    ----------
    run : DryRun
    standing : Standing
    needle : Needle
    ink_ul : float, µL
        Written into the bath, which rises by it.
    """
    checks = [_wall(run, standing, needle), _hub(run, standing, needle)]
    if standing.bath_mm is not None:
        checks += _depth(run, standing, needle, ink_ul)
    return checks


def tips_of(run: DryRun) -> FloatArray:
    """Tip before and after each row, (n, 2, 3)."""
    ends = run.program.target[:, :3]
    begins = np.vstack([run.program.start[None, :3], ends[:-1]])[: len(ends)]
    return np.stack([begins, ends], axis=1)


def _wall(run: DryRun, standing: Standing, needle: Needle) -> Check:
    """Least distance between needle and wall."""
    dish = standing.dish
    gap = wall_gap(tips_of(run), run.program.kind == MOVE, standing, needle.outer_mm)
    row = int(gap.argmin()) if len(gap) else -1
    value = float(gap[row]) if row >= 0 and np.isfinite(gap[row]) else dish.inner_x_mm / 2
    return Check(
        "needle to the dish's wall",
        value,
        WALL_CLEARANCE_MM,
        "mm",
        value >= WALL_CLEARANCE_MM,
        f"line {int(run.program.line[row])}" if row >= 0 else "",
        f"it would run into the wall of {dish.name}; take a wider dish, move the part or say where "
        "the dish stands (dish_centre_mm)",
    )


def hub_remedy(needle: Needle, dish: Dish) -> str:
    """What to do where a hub meets a wall."""
    taken = "" if needle.hub_outer_mm else f", taken as {HUB_MM:g} mm wide (needle: hub_outer_mm)"
    return (
        f"the hub of {needle.name}{taken} would hit the wall of {dish.name}; take a longer "
        "needle, a lower or wider dish, or raise the part"
    )


def _hub(run: DryRun, standing: Standing, needle: Needle) -> Check:
    """Least distance between the wall and what is above the needle's shaft."""
    dish = standing.dish
    gap = hub_gap(tips_of(run), run.program.kind == MOVE, standing, needle)
    row = int(gap.argmin()) if len(gap) else -1
    value = float(gap[row]) if row >= 0 and np.isfinite(gap[row]) else dish.inner_x_mm / 2
    return Check(
        "needle's hub to the dish's wall",
        value,
        WALL_CLEARANCE_MM,
        "mm",
        value >= WALL_CLEARANCE_MM,
        f"line {int(run.program.line[row])}" if row >= 0 else "",
        hub_remedy(needle, dish),
    )


def _depth(run: DryRun, standing: Standing, needle: Needle, ink_ul: float) -> list[Check]:
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
