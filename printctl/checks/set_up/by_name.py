"""Load a print set-up (printer, needle, ink, dish, bath) from the names of its profiles."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe, load
from firmware_profiles.tools import THINNEST_BORE
from printctl.checks.set_up.mounted import HeadLoading, SetUp
from printctl.checks.set_up.placed_dish import PlacedDish
from printctl.errors import UsageError


@dataclass(frozen=True)
class ProfileNames:
    """Names of what is mounted; None for what wasn't given.

    Attributes
    ----------
    needle, bath, dish : str or None
        Profiles.
    dish_centre : str or None
        Two numbers, mm.
    bath_depth : float or None, mm
    thinnest_bore : float
        As of `SetUp`.
    """

    needle: str | None
    bath: str | None
    dish: str | None
    dish_centre: str | None
    bath_depth: float | None
    thinnest_bore: float = THINNEST_BORE


def set_up(
    printer: Printer,
    syringe: str,
    ink: str,
    tip: tuple[float, float, float],
    mounted: ProfileNames,
) -> SetUp:
    """Set-up of named profiles; of several heads syringe, ink and needle may be one for each.

    Raises
    ------
    UsageError, ProfileError
        For a centre that isn't two numbers; for a profile that there isn't.
    """
    bath, dish = mounted.bath, mounted.dish
    standing = None
    if dish is not None:
        centre = read_dish_centre(mounted.dish_centre) if mounted.dish_centre else tip[:2]
        standing = PlacedDish(load(Dish, dish), centre, printer.z_mm.low, mounted.bath_depth)
    elif mounted.dish_centre is not None or mounted.bath_depth is not None:
        raise UsageError("--dish-centre and --bath-depth belong to a dish; give --dish")
    loads = loads_of(printer, syringe, ink, mounted.needle)
    return SetUp(
        printer,
        loads[0].syringe,
        loads[0].ink,
        loads[0].needle,
        None if bath is None else load(Bath, bath),
        standing,
        loads if printer.heads else (),
        mounted.thinnest_bore,
    )


def of_each(printer: Printer, text: str, option: str) -> list[str]:
    """Names of one thing in each head: ``left,right``, or one for all.

    Raises
    ------
    UsageError
        For another number of names than there are heads.
    """
    names = text.split(",")
    if len(names) not in (1, printer.head_count):
        raise UsageError(
            f"{option} {text!r} names {len(names)}, and {printer.name} has {printer.head_count} "
            "heads; name one of each, with a comma between, or one for all"
        )
    return names * (printer.head_count // len(names))


def syringes_of(printer: Printer, syringe: str) -> list[Syringe]:
    """The syringe in each head."""
    return [load(Syringe, name) for name in of_each(printer, syringe, "--syringe")]


def loads_of(
    printer: Printer, syringe: str, ink: str, needle: str | None
) -> tuple[HeadLoading, ...]:
    """What each head holds."""
    inks = [load(Ink, name) for name in of_each(printer, ink, "--ink")]
    needles: list[Needle | None] = [None] * printer.head_count
    if needle is not None:
        needles = [load(Needle, name) for name in of_each(printer, needle, "--needle")]
    parts = zip(syringes_of(printer, syringe), inks, needles, strict=True)
    return tuple(HeadLoading(*part) for part in parts)


def read_dish_centre(text: str) -> tuple[float, float]:
    """Read the option --dish-centre, X,Y in mm."""
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError as exc:
        raise UsageError(f"--dish-centre {text!r} isn't X,Y in mm; write it like 100,100") from exc
    return x, y
