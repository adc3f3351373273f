"""Refuse a recipe with `observe` for a plate, several heads, a valve or no named device."""

from __future__ import annotations

from firmware_profiles import Printer
from printctl.errors import UsageError
from printctl.recipe import Recipe
from printctl.recipe.making import Embedded

_SIMULATED = "simulated"


def refuse_unobservable(recipe: Recipe, printer: Printer) -> None:
    """Refuse what an observer can't do, before anything is made.

    Raises
    ------
    UsageError
        For several heads or a valve, a plate, a controller that runs files by itself, no device, or
        a laser line over a bath.
    """
    part = recipe.observe
    if part is None:
        return
    if printer.heads or printer.pneumatic is not None or not printer.streamed:
        raise UsageError(
            f"observe: {printer.name} has several heads, a valve, or runs files by itself, and "
            "mends are put into the lines of one plunger; leave observe out"
        )
    if recipe.plate is not None:
        raise UsageError("observe: prints of a plate can't be observed; leave observe out")
    covered = isinstance(recipe.toolpath, Embedded) or recipe.printer.bath_depth_mm is not None
    if part.device == "laser_line" and covered:
        raise UsageError(
            "observe.device is laser_line, and what is printed lies in a bath (vessels written "
            "into it, or printer.bath_depth_mm above the part): of that a laser line sees the "
            "bath's surface alone; take oct or camera, or print layers that lie bare"
        )
    if not part.source and recipe.printer.port != _SIMULATED:
        raise UsageError(
            f"observe: no source is named, which means a simulated {part.device}, but port is "
            f"{recipe.printer.port}; name the {part.device} (source)"
        )
