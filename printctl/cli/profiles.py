"""`printctl profiles`: which printers, needles, syringes, inks and baths are known."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from firmware_profiles import (
    Bath,
    Facts,
    Ink,
    Needle,
    Printer,
    ProfileError,
    Syringe,
    load,
    shipped,
)
from printctl.cli.options import JsonFlag, print_json, print_lines

KINDS: dict[str, type[Facts]] = {
    "printer": Printer,
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "bath": Bath,
}


def profiles(
    name: Annotated[
        str | None, typer.Argument(help="Show one profile whole: its shipped name or a .yaml file.")
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """List the shipped profiles, or show one with its source."""
    found = _all() if name is None else _one(name)
    if as_json:
        print_json(found)
        return
    for kind, entries in found.items():
        for entry, facts in entries.items():
            print_lines(f"{kind:<8} {entry:<18} {facts['name']}")
            if name is not None:
                print_lines(*(f"  {key}: {value}" for key, value in facts.items()))


def _all() -> dict[str, dict[str, Any]]:
    return {
        kind: {entry: load(model, entry).model_dump(mode="json") for entry in shipped(model)}
        for kind, model in KINDS.items()
    }


def _one(name: str) -> dict[str, dict[str, Any]]:
    if name.endswith((".yaml", ".yml")):
        return _from_file(name)
    for kind, model in KINDS.items():
        if name in shipped(model):
            return {kind: {name: load(model, name).model_dump(mode="json")}}
    raise ProfileError(f"no profile {name!r}; `printctl profiles` lists the shipped ones")


def _from_file(name: str) -> dict[str, dict[str, Any]]:
    """Try each sort of profile; the file itself doesn't say which it is."""
    problems = []
    for kind, model in KINDS.items():
        try:
            return {kind: {name: load(model, name).model_dump(mode="json")}}
        except ProfileError as exc:
            problems.append(f"  as {kind}: {exc}")
    raise ProfileError("\n".join([f"{name} is no profile of any sort:", *problems]))
