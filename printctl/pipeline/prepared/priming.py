"""Plan the priming moves that a recipe sets: purge, wipe and prime line."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.toolpath import Toolpath
from design.toolpath.added_moves import HeadPriming, PrimeLine, Purge, Surroundings, priming
from printctl.checks.set_up import ABOVE_WALL_MM
from printctl.errors import UsageError
from printctl.pipeline.context import RunContext
from printctl.pipeline.job.heads import Filled, layer_lines_um
from printctl.recipe.sections.toolpath import Fresh, PrimePart

ABOVE_PART_MM: Final = 1.0


def primed(
    context: RunContext, first: Toolpath, top_mm: float, relief_ul: float | None
) -> Toolpath:
    """Return the priming moves before ``first``, the part's path or its first part.

    Parameters
    ----------
    context : RunContext
    first : Toolpath
    top_mm : float, mm
        Highest that the part's path goes, part's frame.
    relief_ul : float or None, µL
        Of every head, in place of its ink's own.

    Raises
    ------
    UsageError
        For a purge of a pneumatic head, or one over a wall that nobody named.
    """
    part = context.recipe.toolpath.prime
    if part is None:
        raise UsageError("toolpath.prime isn't given; there is nothing to do before the part")
    _check_purge(context, part)
    heads = [_head(context, part, k, relief_ul) for k in range(context.printer.head_count)]
    speed = context.recipe.toolpath.travel_speed_mm_s
    around = Surroundings(
        context.written_bounds,
        safe_height_mm(context, part, top_mm),
        speed,
        min(speed, context.printer.max_speed_mm_s.z),
    )
    return priming(first.start[0], int(first.tool[0]), heads, around, first)


def safe_height_mm(context: RunContext, part: PrimePart, top_mm: float) -> float:
    """Height of the ways to and from the cup and the line, part's frame, mm.

    Above the part, the cup and the dish's wall.
    """
    place = float(context.place_mm[2])
    heights = [top_mm + ABOVE_PART_MM]
    heights += [at[2] - place for at in (part.cup_mm, part.wipe_mm) if at is not None]
    if context.dish is not None and part.cup_mm is not None:
        heights.append(context.printer.z_mm.low + context.dish.wall_mm + ABOVE_WALL_MM - place)
    return max(heights)


def _check_purge(context: RunContext, part: PrimePart) -> None:
    if part.cup_mm is None:
        return
    if context.printer.pneumatic is not None:
        raise UsageError(
            f"toolpath.prime: purge_ul is {part.purge_ul:g}, and {context.printer.name} has a "
            "pneumatic head, whose valve opens along a path alone; purge by hand, and keep line_mm"
        )
    if context.dish is None:
        raise UsageError(
            "toolpath.prime: the way from cup_mm to the part crosses the dish's wall, and no dish "
            "is named; say which it is (printer.dish)"
        )


def _head(
    context: RunContext, part: PrimePart, number: int, relief_ul: float | None
) -> HeadPriming:
    load = context.loads[number]
    line = None
    if part.line_mm > 0:
        area, speed = _line_of(context, load, number)
        line = PrimeLine(part.line_mm, part.gap_mm, area, speed)
    return HeadPriming(
        retract_ul=load.ink.retract_ul if relief_ul is None else relief_ul,
        plunger_ul_s=load.ink.plunger_ul_s,
        purge=_purge(context, part),
        line=line,
        dwell_s=load.ink.dwell_s,
    )


def _purge(context: RunContext, part: PrimePart) -> Purge | None:
    if part.cup_mm is None:
        return None
    wipe = None if part.wipe_mm is None else _in_part(context, part.wipe_mm)
    return Purge(_in_part(context, part.cup_mm), part.purge_ul, wipe)


def _in_part(context: RunContext, place: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.array(place) - context.place_mm


def _line_of(context: RunContext, load: Filled, number: int) -> tuple[float, float]:
    """Cross-section (mm²) and speed (mm/s) of a head's line.

    A line of the layers, or a filament as thick as the needle's bore.
    """
    part = context.recipe.toolpath
    if isinstance(part, Fresh):
        heads = context.recipe.printer.heads
        width = layer_lines_um(part, heads, context.printer.head_count)[number] * 1e-3
        return width * part.layer_um * 1e-3, part.write_speed_mm_s
    return math.pi / 4 * load.needle.inner_mm**2, part.write_speed_mm_s
