"""A dish where it stands, and how far a needle and its hub stay from its wall."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Dish, Needle

FloatArray = NDArray[np.float64]
WALL_CLEARANCE_MM: Final = 1.0
"""Kept between needle and wall: a touch-off by eye is no better."""
ABOVE_WALL_MM: Final = 2.0
"""Between the dish's wall and the tips that cross it."""
HUB_MM: Final = 12.0
"""Taken for a hub that nobody measured: a Luer lock's outside, and some."""


@dataclass(frozen=True)
class Standing:
    """A dish on the printer.

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


def wall_gap(
    tips: FloatArray, moves: NDArray[np.bool_], standing: Standing, outer_mm: float
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
    standing : Standing
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
    tips: FloatArray, moves: NDArray[np.bool_], standing: Standing, needle: Needle
) -> FloatArray:
    """Distance of the needle's hub to the wall in each move, as `wall_gap`."""
    hubs = tips + [0.0, 0.0, needle.length_mm]
    return wall_gap(hubs, moves, standing, needle.hub_outer_mm or HUB_MM)
