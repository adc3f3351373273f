"""Compute the smallest and widest printable lumen and the thinnest wall, by method and needle."""

from __future__ import annotations

from dataclasses import dataclass

from design.toolpath.embedded import EmbeddedOptions
from design.toolpath.fresh import FreshOptions
from firmware_profiles import Needle
from printctl.pipeline.job.heads import needle_options
from printctl.recipe.sections.toolpath import Embedded, Fresh


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
    source : str
        What the limits follow from, for the report.
    """

    lumen_mm: float
    widest_mm: float | None
    wall_mm: float
    source: str


def fresh_limits(part: Fresh, scale: float, asked_mm: float | None = None) -> Printability:
    """Limits of FRESH layers: two layers and one line for a lumen, two lines for a wall.

    Parameters
    ----------
    part : Fresh
        The recipe's section on layers.
    scale : float
        Size of the print over that of the design (`print_scale`).
    asked_mm : float, optional
        The thinnest lumen that the recipe asks for, in diameter, in the design's size.
    """
    lines = FreshOptions(layer_height_mm=part.layer_um * 1e-3, line_width_mm=part.line_um * 1e-3)
    lumen = max(lines.smallest_lumen_mm, scale * (asked_mm or 0.0))
    source = f"layers of {part.layer_um:g} µm and lines of {part.line_um:g} µm{_printed(scale)}"
    return Printability(lumen / scale, None, lines.smallest_wall_mm / scale, source)


def embedded_limits(
    part: Embedded, scale: float, needle: Needle, held_mm: float, asked_mm: float | None = None
) -> Printability:
    """Limits of embedded centrelines.

    A lumen needs the needle's thinnest filament, a wall room for the needle's tip beside the next
    filament. The widest is what the plunger can fill or the bath holds, whichever is less.

    Parameters
    ----------
    part, scale, asked_mm
        As of `fresh_limits`.
    needle : Needle
        The needle that writes.
    held_mm : float
        Diameter of the thickest filament that the bath's yield stress holds.
    """
    filament = EmbeddedOptions(**needle_options(needle), thinnest=part.thinnest_bore)
    lumen = max(filament.smallest_lumen_mm, scale * (asked_mm or 0.0))
    filled = filament.largest_lumen_mm
    by = "the bath's yield stress holds" if held_mm < filled else "the plunger's flow fills"
    widest = min(held_mm, filled)
    source = (
        f"needle of {needle.inner_mm:g} mm bore and {needle.outer_mm:g} mm outside; at most "
        f"{widest:.3g} mm, which {by}{_printed(scale)}"
    )
    wall = filament.smallest_wall_mm(lumen / 2)
    return Printability(lumen / scale, widest / scale, wall / scale, source)


def _printed(scale: float) -> str:
    return "" if scale == 1 else f", printed {scale:g} times the design's size"
