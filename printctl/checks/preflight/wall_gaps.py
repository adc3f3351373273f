"""Compute and check the distance of needle and hub to a dish's wall over all moves of a job."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Dish, Needle
from kernels.arrays import FloatArray
from printctl.checks.set_up.check import Check
from printctl.checks.set_up.placed_dish import HUB_MM, WALL_CLEARANCE_MM, PlacedDish


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
        "needle to the dish's wall",
        wall_gap(tips, moves, standing, needle.outer_mm),
        standing.dish,
        places,
        f"it would run into the wall of {standing.dish.name}; take a wider dish, move the part or "
        "say where the dish stands (dish_centre_mm)",
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
        "needle's hub to the dish's wall",
        hub_gap(tips, moves, standing, needle),
        standing.dish,
        places,
        hub_remedy(needle, standing.dish),
    )


def hub_remedy(needle: Needle, dish: Dish) -> str:
    """What to do where a hub meets a wall."""
    taken = "" if needle.hub_outer_mm else f", taken as {HUB_MM:g} mm wide (needle: hub_outer_mm)"
    return (
        f"the hub of {needle.name}{taken} would hit the wall of {dish.name}; take a longer "
        "needle, a lower or wider dish, or raise the part"
    )


def _least(what: str, gap: FloatArray, dish: Dish, places: PlaceNames, remedy: str) -> Check:
    row = int(gap.argmin()) if len(gap) else -1
    value = float(gap[row]) if row >= 0 and np.isfinite(gap[row]) else dish.inner_x_mm / 2
    return Check(
        what,
        value,
        WALL_CLEARANCE_MM,
        "mm",
        value >= WALL_CLEARANCE_MM,
        places[row] if row >= 0 else "",
        remedy,
    )
