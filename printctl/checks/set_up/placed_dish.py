"""Dish at its position on the printer; distance of needle and hub to its wall in one move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from firmware_profiles import Dish, Needle

Point = tuple[float, float, float]
WALL_CLEARANCE_MM: Final = 1.0
"""Kept between needle and wall: a touch-off by eye is no better."""
ABOVE_WALL_MM: Final = 2.0
"""Between the dish's wall and the tips that cross it."""
HUB_MM: Final = 12.0
"""Taken for a hub that nobody measured: a Luer lock's outside, and some."""


@dataclass(frozen=True)
class PlacedDish:
    """Dish at its position on the printer.

    Attributes
    ----------
    dish : Dish
    centre_mm : (x, y), mm
        Printer's frame.
    floor_mm : float, mm
        Height of its floor, printer's frame.
    bath_mm : float or None, mm
        Depth of the bath; None where nobody said it.
    bath_key : str
        Where that is said, for messages.
    """

    dish: Dish
    centre_mm: tuple[float, float]
    floor_mm: float
    bath_mm: float | None = None
    bath_key: str = "printer.bath_depth_mm"

    @property
    def area_mm2(self) -> float:
        """Of the bath's surface, mm²."""
        box = self.dish.inner_x_mm * self.dish.inner_y_mm
        return math.pi / 4 * box if self.dish.shape == "round" else box

    def risen_mm(self, needle: Needle, deepest_mm: float, ink_ul: float) -> float:
        """Depth of the bath when ink and needle are in it, mm; of one that nobody said, 0.

        Parameters
        ----------
        needle : Needle
        deepest_mm : float, mm
            How far it dips in.
        ink_ul : float, µL
        """
        if self.bath_mm is None:
            return 0.0
        dipped_ul = math.pi / 4 * needle.outer_mm**2 * max(deepest_mm, 0.0)
        return self.bath_mm + (max(ink_ul, 0.0) + dipped_ul) / self.area_mm2


def wall_gap_of(ends: Sequence[Point], standing: PlacedDish, outer_mm: float) -> float:
    """Return the distance of a needle to the wall in one straight move, mm; above it infinite.

    As `printctl.checks.preflight.wall_gaps.wall_gap` of many moves, without NumPy, which a
    station's and a link's process don't load.

    Parameters
    ----------
    ends : two (x, y, z), mm
        Before and after, printer's frame.
    standing : PlacedDish
    outer_mm : float, mm
        The needle's.
    """
    dish = standing.dish
    if min(z for _, _, z in ends) >= standing.floor_mm + dish.wall_mm:
        return math.inf
    aside = [(abs(x - standing.centre_mm[0]), abs(y - standing.centre_mm[1])) for x, y, _ in ends]
    if dish.shape == "round":
        gap = min(dish.inner_x_mm / 2 - math.hypot(x, y) for x, y in aside)
    else:
        gap = min(min(dish.inner_x_mm / 2 - x, dish.inner_y_mm / 2 - y) for x, y in aside)
    return gap - outer_mm / 2


def hub_gap_of(ends: Sequence[Point], standing: PlacedDish, needle: Needle) -> float:
    """Return the distance of the needle's hub to the wall in one move, as `wall_gap_of`."""
    hubs = [(x, y, z + needle.length_mm) for x, y, z in ends]
    return wall_gap_of(hubs, standing, needle.hub_outer_mm or HUB_MM)
