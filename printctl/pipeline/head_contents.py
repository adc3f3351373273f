"""Load the syringe, ink and needle of each head that a recipe names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.checks.set_up import HeadLoading
from printctl.errors import UsageError
from printctl.recipe.making import PrinterPart


@dataclass(frozen=True)
class Filled(HeadLoading):
    """Loading of a head whose needle is known."""

    needle: Needle


def filled_heads(
    part: PrinterPart, needle: str, printer: Printer, ink: Ink | None = None
) -> tuple[Filled, ...]:
    """Load what each head holds; of a printer with one the recipe's syringe, ink and needle.

    Parameters
    ----------
    part : PrinterPart
    needle : str
        Profile for heads that name none.
    printer : Printer
    ink : Ink, optional
        In the place of the one head's.

    Raises
    ------
    UsageError
        When the recipe names other heads than the printer has.
    ProfileError
        When a profile is missing or wrong.
    """
    if not part.heads:
        held = load(Ink, part.ink) if ink is None else ink
        one = Filled(load(Syringe, part.syringe), held, load(Needle, needle))
        return (one,) * printer.head_count
    if len(part.heads) != printer.head_count:
        raise UsageError(
            f"printer.heads names {len(part.heads)}, and {printer.name} has "
            f"{printer.head_count}; name what each holds, or choose another profile"
        )
    return tuple(
        Filled(
            load(Syringe, head.syringe), load(Ink, head.ink), load(Needle, head.needle or needle)
        )
        for head in part.heads
    )


def needle_options(needle: Needle) -> dict[str, Any]:
    """A needle's measures as `EmbeddedOptions` calls them, mm."""
    return {
        "needle_inner_mm": needle.inner_mm,
        "needle_outer_mm": needle.outer_mm,
        "tip_outer_mm": needle.tip_outer_mm or 0.0,
        "cone_mm": needle.cone_mm or 0.0,
    }
