"""`printctl profiles show`: list the known profiles, or print one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from design.files import write_text
from firmware_profiles import (
    Bath,
    Dish,
    Facts,
    Ink,
    Needle,
    Plate,
    Printer,
    ProfileError,
    Syringe,
    load,
    read_keys,
    shipped,
    shipped_text,
)
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.errors import UsageError

KINDS: dict[str, type[Facts]] = {
    "printer": Printer,
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "bath": Bath,
    "dish": Dish,
    "plate": Plate,
}


class ProfileGroup(TyperGroup):
    """``printctl profiles NAME`` shows a profile: what is no subcommand is a name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put ``show`` in front where no subcommand is named."""
        if not args or (args[0] not in self.commands and args[0] not in ("--help", "-h")):
            args = ["show", *args]
        return super().parse_args(ctx, args)


def show(
    name: Annotated[
        str | None, typer.Argument(help="Show one profile whole: its shipped name or a .yaml file.")
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option("--write", help="Copy the shipped profile to this new file, to correct it."),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """List the shipped profiles, or show one with its source.

    `printctl profiles NAME` is short for it. A file of your own is shown with its defaults.
    """
    if write is not None:
        _copy(name, write)
    profiles = _all() if name is None else _one(name)
    if as_json:
        print_json(profiles)
        return
    for kind, entries in profiles.items():
        for entry, facts in entries.items():
            print_lines(f"{kind:<8} {entry:<18} {facts['name']}{_sizes(kind, facts)}")
            if name is not None:
                print_lines(*(f"  {key}: {value}" for key, value in facts.items()))


def _copy(name: str | None, to: Path) -> None:
    """Write a shipped profile to a file of the user's.

    Raises
    ------
    UsageError
        When the file is there already, isn't called .yaml, or nothing shipped is named.
    """
    if to.suffix not in (".yaml", ".yml"):
        raise UsageError(f"--write {to}: a profile's file ends in .yaml")
    if to.exists():
        raise UsageError(f"--write {to}: it is there already; name a new file")
    if name is None or name.endswith((".yaml", ".yml")):
        raise UsageError("--write copies a shipped profile: name one of `printctl profiles`")
    kind, _ = find_profile(name)
    write_text(to, shipped_text(KINDS[kind], name))
    messages().print(f"wrote {to}: give it in place of {name}", markup=False)


def _sizes(kind: str, facts: dict[str, Any]) -> str:
    """What one chooses a needle or a syringe by."""
    if kind == "needle":
        return f": bore {facts['inner_mm']:g}, outer {facts['outer_mm']:g} mm"
    if kind == "syringe":
        return f": bore {facts['inner_mm']:g} mm, dead volume {facts['dead_volume_ul']:g} µL"
    if kind == "plate":
        count = facts["rows"] * facts["columns"]
        return f": {count} wells, {facts['well_x_mm']:g} mm, {facts['well_depth_mm']:g} mm deep"
    return ""


def find_profile(name: str) -> tuple[str, Facts]:
    """Sort and facts of a shipped name or of a file, which itself doesn't say its sort.

    Raises
    ------
    ProfileError
        When there is none; of a file that is no profile it says what the sort wants whose keys
        it has most of.
    """
    if not name.endswith((".yaml", ".yml")):
        for kind, model in KINDS.items():
            if name in shipped(model):
                return kind, load(model, name)
        raise ProfileError(
            f"no profile {name!r}; `printctl profiles` lists the shipped ones, a file of your own "
            "ends in .yaml"
        )
    if not Path(name).is_file():
        raise ProfileError(f"profile file {name} doesn't exist; check the path")
    kind = _likeliest(name)
    return kind, load(KINDS[kind], name)


def _likeliest(file: str) -> str:
    """The sort of profile that most of a file's keys belong to."""
    keys = set(read_keys(file)) - set(Facts.model_fields)
    shared = {kind: len(keys & set(model.model_fields)) for kind, model in KINDS.items()}
    kind = max(shared, key=lambda one: shared[one])
    if not shared[kind]:
        raise ProfileError(
            f"{file} has no key of any sort of profile ({', '.join(KINDS)}); "
            "`printctl profiles NAME` shows a shipped one with all its keys"
        )
    return kind


def _all() -> dict[str, dict[str, Any]]:
    return {
        kind: {entry: load(model, entry).model_dump(mode="json") for entry in shipped(model)}
        for kind, model in KINDS.items()
    }


def _one(name: str) -> dict[str, dict[str, Any]]:
    kind, facts = find_profile(name)
    return {kind: {name: facts.model_dump(mode="json")}}
