"""Distances of needle and hub to a dish's wall, over all moves of a job."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Needle
from printctl.set_up.standing import HUB_MM, Standing

FloatArray = NDArray[np.float64]


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
