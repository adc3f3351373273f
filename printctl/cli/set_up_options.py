"""Options that say what is mounted for a G-code file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe, load
from printctl.errors import UsageError
from printctl.preflight import SetUp, Standing

NeedleOption = Annotated[
    str | None, typer.Option("--needle", help="Needle profile; force and walls need it.")
]
BathOption = Annotated[
    str | None, typer.Option("--bath", help="Bath profile; chemistry and warmth need it.")
]
DishOption = Annotated[str | None, typer.Option("--dish", help="Dish profile; walls need it.")]
DishCentreOption = Annotated[
    str | None,
    typer.Option("--dish-centre", metavar="X,Y", help="Printer's frame; below --start if not."),
]
BathDepthOption = Annotated[
    float | None, typer.Option("--bath-depth", help="How high the dish is filled, mm.", min=0.1)
]


@dataclass(frozen=True)
class Mounted:
    """What these options say; None for what wasn't given.

    Attributes
    ----------
    needle, bath, dish : str or None
        Profiles.
    dish_centre : str or None
        Two numbers, mm.
    bath_depth : float or None, mm
    """

    needle: str | None
    bath: str | None
    dish: str | None
    dish_centre: str | None
    bath_depth: float | None


def set_up(
    printer: Printer,
    syringe: Syringe,
    ink: str,
    tip: tuple[float, float, float],
    mounted: Mounted,
) -> SetUp:
    """What the options name.

    Raises
    ------
    UsageError, ProfileError
        For a centre that isn't two numbers; for a profile that there isn't.
    """
    needle, bath, dish = mounted.needle, mounted.bath, mounted.dish
    standing = None
    if dish is not None:
        centre = _centre(mounted.dish_centre) if mounted.dish_centre else tip[:2]
        standing = Standing(load(Dish, dish), centre, printer.z_mm.low, mounted.bath_depth)
    elif mounted.dish_centre is not None or mounted.bath_depth is not None:
        raise UsageError("--dish-centre and --bath-depth belong to a dish; give --dish")
    return SetUp(
        printer,
        syringe,
        load(Ink, ink),
        None if needle is None else load(Needle, needle),
        None if bath is None else load(Bath, bath),
        standing,
    )


def _centre(text: str) -> tuple[float, float]:
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError as exc:
        raise UsageError(f"--dish-centre {text!r} isn't X,Y in mm; write it like 100,100") from exc
    return x, y
