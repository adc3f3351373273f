"""`printctl mount`: enter or show what is mounted on a printer and how full its syringe is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from firmware_profiles import Printer, ProfileError, load
from printctl.checks.set_up import NONE, ProfileNames, read_dish_centre
from printctl.cli.declare import json_command
from printctl.cli.options import print_result
from printctl.errors import UsageError
from printctl.machine.prints.mounted import mount_parts
from printctl.machine.records.mounting import (
    PARTS,
    Mounting,
    all_mountings,
    as_kept,
    load_mounting,
)
from printctl.settings import of, opt

_PROFILE = "a shipped profile or a .yaml file; none for nothing."


@json_command
def mount(
    printer: str | None = opt("Printer profile; required if several printers have mounted parts."),
    syringe: str | None = opt(f"Syringe: {_PROFILE}"),
    fill_ul: float | None = opt("Ink in the syringe, µL; default: unknown.", min=0.0),
    needle: str | None = opt(f"Needle: {_PROFILE}"),
    ink: str | None = opt(f"Ink: {_PROFILE}"),
    bath: str | None = opt(f"Bath: {_PROFILE}"),
    bath_depth: float | None = of(ProfileNames, "bath_depth"),
    dish: str | None = opt(f"Dish: {_PROFILE}"),
    dish_centre: str | None = opt("Dish centre in printer coordinates, mm.", metavar="X,Y"),
) -> None:
    """Enter what is mounted on a printer and how full its syringe is; alone it shows that.

    Print, calibrate and the page use it where no part is named, and refuse a part that contradicts
    it. Prints subtract what they push. After a change of syringe the ink left is unknown until
    --fill-ul is given.
    """
    named = {"syringe": syringe, "needle": needle, "ink": ink, "bath": bath, "dish": dish}
    given: dict[str, Any] = {
        part: "" if name == NONE else as_kept(name)
        for part, name in named.items()
        if name is not None
    }
    if bath_depth is not None:
        given["bath_depth_mm"] = bath_depth
    if dish_centre is not None:
        given["dish_centre_mm"] = read_dish_centre(dish_centre)
    known = all_mountings()
    if not given and fill_ul is None:
        _show([load_mounting(printer)] if printer else known)
        return
    if printer is None and len(known) != 1:
        raise UsageError("--printer is missing; name the printer that this is mounted on")
    key = as_kept(printer or known[0].printer)
    _show([mount_parts(load_mounting(key), load(Printer, key), given, fill_ul)])


def _show(mountings: list[Mounting]) -> None:
    facts = [_facts(one) for one in mountings]
    lines = [line for one in facts for line in _lines(one)]
    print_result({"mounted": facts}, lines or ["nothing is mounted on any printer"])


def _facts(kept: Mounting) -> dict[str, Any]:
    left = reserved = None
    with suppress(ProfileError):  # a profile that has gone since
        printer = load(Printer, kept.printer)
        left, reserved = kept.left_ul(printer), kept.reserved_ul(printer)
    shown = (*PARTS, "bath_depth_mm", "dish_centre_mm")
    return {
        "printer": kept.printer,
        "left_ul": left,
        "reserved_ul": reserved,
        **{name: getattr(kept.parts, name) for name in shown},
    }


def _lines(facts: dict[str, Any]) -> Iterator[str]:
    yield facts["printer"]
    for part in PARTS:
        text = facts[part] or "not known"
        if part == "syringe" and facts[part]:
            left = facts["left_ul"]
            text += ", ink left not known" if left is None else f", {left:.0f} µL left"
            if facts["reserved_ul"]:
                text += (
                    f" to push; {facts['reserved_ul']:.0f} µL more stay in it (dead volume of the "
                    "syringe, end of the drive)"
                )
        if part == "bath" and facts["bath_depth_mm"] is not None:
            text += f", {facts['bath_depth_mm']:g} mm deep"
        yield f"  {part:<8} {text}"
