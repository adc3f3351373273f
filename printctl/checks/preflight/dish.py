"""Checks of dish and bath: walls, floor and depth against the needle's moves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Bath, Dish, Needle, load, shipped
from gcode.dry_run.run import DryRun
from gcode.program.modal import MOVE
from kernels.arrays import FloatArray
from printctl.checks.kinds import Kind
from printctl.checks.preflight.mounted import longer_needle
from printctl.checks.set_up import (
    HUB_MM,
    RECIPE_KEYS,
    WALL_CLEARANCE_MM,
    Check,
    PlacedDish,
    finding,
)


class PlaceNames(Protocol):
    """Name of each move's place, for messages."""

    def __getitem__(self, row: int, /) -> str: ...


def wall_gap(
    tips: FloatArray, moves: NDArray[np.bool_], standing: PlacedDish, outer_mm: float
) -> FloatArray:
    """Distance of a needle to the wall in each move, (n,), mm; infinite where it is above it.

    Both ends of a move count if one is below the top. A dish is convex, so a move whose ends are
    inside is inside.

    Parameters
    ----------
    tips : (n, 2, 3) float64, mm
        Before and after each row, printer's frame.
    moves : (n,) bool
        Rows that count.
    standing : PlacedDish
    outer_mm : float, mm
        The needle's.
    """
    dish = standing.dish
    low = (tips[:, :, 2].min(axis=1) < standing.floor_mm + dish.wall_mm) & moves
    off = np.abs(tips[:, :, :2] - standing.centre_mm)
    if dish.shape == "round":
        gap = dish.inner_x_mm / 2 - np.linalg.norm(off, axis=2)
    else:
        gap = np.minimum(dish.inner_x_mm / 2 - off[:, :, 0], dish.inner_y_mm / 2 - off[:, :, 1])
    return np.where(low, gap.min(axis=1) - outer_mm / 2, np.inf)


def hub_gap(
    tips: FloatArray, moves: NDArray[np.bool_], standing: PlacedDish, needle: Needle
) -> FloatArray:
    """Distance of the needle's hub to the wall in each move, as `wall_gap`."""
    hubs = tips + [0.0, 0.0, needle.length_mm]
    return wall_gap(hubs, moves, standing, needle.hub_outer_mm or HUB_MM)


def wall_check(
    tips: FloatArray,
    moves: NDArray[np.bool_],
    standing: PlacedDish,
    needle: Needle,
    places: PlaceNames,
) -> Check:
    """Least distance between needle and wall; arrays as of `wall_gap`."""
    return _least(
        Kind.WALL,
        "needle to dish wall",
        wall_gap(tips, moves, standing, needle.outer_mm),
        standing.dish,
        places,
        f"the needle would hit the wall of {standing.dish.name}; use a wider dish, move the part, "
        f"or correct the dish position ({standing.centre_key})",
    )


def hub_check(
    tips: FloatArray,
    moves: NDArray[np.bool_],
    standing: PlacedDish,
    needle: Needle,
    places: PlaceNames,
) -> Check:
    """Least distance between the wall and what is above the needle's shaft."""
    return _least(
        Kind.HUB,
        "needle hub to dish wall",
        hub_gap(tips, moves, standing, needle),
        standing.dish,
        places,
        hub_remedy(needle, standing.dish),
    )


def hub_remedy(needle: Needle, dish: Dish) -> str:
    """What to do where a hub meets a wall."""
    taken = "" if needle.hub_outer_mm else f", assumed {HUB_MM:g} mm wide (needle: hub_outer_mm)"
    return (
        f"the hub of {needle.name}{taken} would hit the wall of {dish.name}; use a longer needle, "
        "a lower or wider dish, or raise the part"
    )


def _least(
    kind: Kind, what: str, gap: FloatArray, dish: Dish, places: PlaceNames, remedy: str
) -> Check:
    row = int(gap.argmin()) if len(gap) else -1
    value = float(gap[row]) if row >= 0 and np.isfinite(gap[row]) else dish.inner_x_mm / 2
    return Check(
        kind,
        what,
        value,
        WALL_CLEARANCE_MM,
        "mm",
        value >= WALL_CLEARANCE_MM,
        places[row] if row >= 0 else "",
        remedy,
    )


_TINY_MM: Final = 1e-6


def floor_check(
    run: DryRun, bath: Bath, floor_mm: float, place_key: str = RECIPE_KEYS.place
) -> Check:
    """Check the tip's least distance from the dish's floor."""
    value = float(run.low_mm[2]) - floor_mm
    return Check(
        Kind.FLOOR,
        "lowest tip above the dish floor",
        value,
        bath.floor_clearance_mm,
        "mm",
        value >= bath.floor_clearance_mm - _TINY_MM,
        f"line {int(run.low_line[2])}",
        f"the needle could touch the floor: {bath.name} requires {bath.floor_clearance_mm:g} mm "
        f"below the tip (floor_clearance_mm); raise the part ({place_key})",
    )


def unknown_dish(option: str, *, real: bool = False) -> Check:
    """No dish is named, so its walls and the bath's depth can't be checked: refused if ``real``."""
    return finding(
        Kind.UNKNOWN_PART,
        "dish",
        option,
        "not set, so the needle's distance from the walls wasn't checked; specify the dish",
        "refuses" if real else "warns",
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


def _higher_dishes(run: DryRun, standing: PlacedDish, needle: Needle, ink_ul: float) -> str:
    """Name the shipped dishes that hold the bath and let the needle pass, the lowest first."""
    if _risen_mm(run, standing, needle, ink_ul) <= standing.dish.wall_mm:
        return ""
    tips, moves, lines = tips_of(run), run.program.kind == MOVE, _Lines(run)
    fit = []
    for name in shipped(Dish):
        other = replace(standing, dish=load(Dish, name))
        walls = [check(tips, moves, other, needle, lines) for check in (wall_check, hub_check)]
        holds = _risen_mm(run, other, needle, ink_ul) <= other.dish.wall_mm
        if holds and all(one.passed for one in walls):
            fit.append((other.dish.wall_mm, name))
    if not fit:
        return "; no shipped dish holds this bath and lets the needle pass"
    names = ", ".join(f"{name} ({wall:g} mm)" for wall, name in sorted(fit))
    return f", or use a higher dish: {names}"


def _risen_mm(run: DryRun, standing: PlacedDish, needle: Needle, ink_ul: float) -> float:
    """Depth of the bath with needle and ink in it, mm."""
    deepest = standing.floor_mm + (standing.bath_mm or 0.0) - float(run.low_mm[2])
    return standing.risen_mm(needle, deepest, ink_ul)


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
    risen = _risen_mm(run, standing, needle, ink_ul)
    return [
        Check(
            Kind.BATH_DEPTH,
            "bath depth with ink and needle vs. dish wall",
            risen,
            dish.wall_mm,
            "mm",
            risen <= dish.wall_mm,
            standing.bath_key,
            f"{dish.name} would overflow; fill less{_higher_dishes(run, standing, needle, ink_ul)}",
        ),
        Check(
            Kind.BATH_SURFACE,
            "highest extrusion vs. bath surface",
            top,
            surface,
            "mm",
            top <= surface + _TINY_MM,
            f"line {int(run.program.line[row])}" if row >= 0 else "",
            f"it would print in air; fill more ({standing.bath_key}) or lower the part",
        ),
        Check(
            Kind.NEEDLE_LENGTH,
            "immersion depth vs. needle length",
            deepest,
            needle.length_mm,
            "mm",
            deepest <= needle.length_mm + _TINY_MM,
            f"line {int(run.low_line[2])}",
            f"the hub of {needle.name} would dip into the bath; {longer_needle(needle, deepest)}, "
            "or fill less",
        ),
    ]
