"""Refuse a part too wide for its well with the needle's clearance, before planning."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Dish
from printctl.checks.set_up import WALL_CLEARANCE_MM
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.recipe.making import Fresh


def check_fit(context: RunContext) -> None:
    """Refuse a part that its needle can't write without touching the well's wall.

    Of layers all of the tissue counts, of embedded writing the vessels alone.

    Raises
    ------
    RecipeError
        With both sizes.
    """
    dish, stand = context.dish, context.stand
    if dish is None or stand is None:
        return
    taken = reach_mm(context, dish) + context.needle.outer_mm / 2 + WALL_CLEARANCE_MM
    inside = np.array([dish.inner_x_mm, dish.inner_y_mm])[: len(taken)] / 2
    if (taken <= inside).all():
        return
    axis = int((taken - inside).argmax())
    along = "" if dish.shape == "round" else f" along {'xy'[axis]}"
    raise RecipeError(
        f"plate: with the needle ({context.needle.outer_mm:g} mm) and {WALL_CLEARANCE_MM:g} mm "
        f"between it and the wall the part takes {2 * taken[axis]:.4g} mm{along}, and well "
        f"{stand.well} has {2 * inside[axis]:g} mm ({dish.name}); take a plate with wider wells or "
        "a smaller part"
    )


def reach_mm(context: RunContext, dish: Dish) -> NDArray[np.float64]:
    """How far the tip goes from the part's middle: (1,) all around, or (2,) along x and y, mm."""
    if isinstance(context.recipe.toolpath, Fresh):
        stretch = context.corrections.stretch
        corners = np.asarray(context.tissue.surface.vertices, dtype=np.float64)
        points = stretch.points(corners * context.recipe.print_scale)
    else:
        points = context.written_network.points
    off = points[:, :2] - context.bounds.mean(axis=0)[:2]
    if dish.shape == "round":
        return np.linalg.norm(off, axis=1).max(keepdims=True)
    return np.abs(off).max(axis=0)
