"""Compute the smallest and widest printable lumen and the thinnest wall, by method and needle."""

from __future__ import annotations

from dataclasses import dataclass

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from firmware_profiles import supported_diameter_mm
from printctl.pipeline.context import RunContext
from printctl.pipeline.heads import needle_options
from printctl.recipe.making import Fresh


@dataclass(frozen=True)
class Printability:
    """Limits of the recipe's way of printing, in the design's size.

    Attributes
    ----------
    lumen_mm : float
        Diameter of the smallest lumen that stays open.
    widest_mm : float or None
        Diameter of the thickest vessel that can be written; None where there is no limit.
    wall_mm : float
        Thinnest wall between two lumens no thinner than `lumen_mm` or what the recipe asks for.
    says : str
        Where the two come from, for the report.
    """

    lumen_mm: float
    widest_mm: float | None
    wall_mm: float
    says: str


def printability(context: RunContext, asked_mm: float | None = None) -> Printability:
    """The limits, for lumens of at least ``asked_mm`` in diameter where that is given.

    All in the design's size, which a recipe may have printed larger or smaller (`print_scale`).

    FRESH: two layers and one line for a lumen, two lines for a wall. Embedded: the thinnest
    filament of the needle, and room for the needle's tip beside the next filament; the widest is
    what the plunger can fill or the bath's yield stress holds, whichever is less.
    """
    part, size = context.recipe.toolpath, 1 / context.recipe.print_scale
    asked_mm = None if asked_mm is None else asked_mm / size
    printed = "" if size == 1 else f", printed {1 / size:g} times the design's size"
    if isinstance(part, Fresh):
        lines = FreshOptions(
            layer_height_mm=part.layer_um * 1e-3, line_width_mm=part.line_um * 1e-3
        )
        lumen = max(lines.smallest_lumen_mm, asked_mm or 0.0)
        says = f"layers of {part.layer_um:g} µm and lines of {part.line_um:g} µm{printed}"
        return Printability(lumen * size, None, lines.smallest_wall_mm * size, says)
    needle = context.needle
    filament = EmbeddedOptions(**needle_options(needle), thinnest=part.thinnest_bore)
    lumen = max(filament.smallest_lumen_mm, asked_mm or 0.0)
    held = supported_diameter_mm(context.bath, context.ink)
    filled = filament.largest_lumen_mm
    by = "the bath's yield stress holds" if held < filled else "the plunger's flow fills"
    says = (
        f"needle of {needle.inner_mm:g} mm bore and {needle.outer_mm:g} mm outside; at most "
        f"{min(held, filled):.3g} mm, which {by}{printed}"
    )
    wall = filament.smallest_wall_mm(lumen / 2)
    return Printability(lumen * size, min(held, filled) * size, wall * size, says)
